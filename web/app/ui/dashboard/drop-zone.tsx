/** Accepts files dropped anywhere on the page, with a hint while they are dragged over it. */
import { Upload } from "lucide";
import { useState } from "preact/hooks";
import { Icon } from "../button";
import { useWindowEvent } from "../hooks";

interface Props {
  /** Whether the server accepts uploads. If not, the browser must not open the dropped file instead. */
  readonly allowed: boolean;
  readonly onFiles: (files: Iterable<File>) => void;
}

export function DropZone({ allowed, onFiles }: Props) {
  const [held, setHeld] = useState(false);
  useWindowEvent("dragover", (event) => {
    if (!event.dataTransfer?.types.includes("Files")) return;
    event.preventDefault();
    event.dataTransfer.dropEffect = allowed ? "copy" : "none";
    setHeld(true);
  });
  useWindowEvent("dragleave", ({ relatedTarget }) => {
    if (relatedTarget === null) setHeld(false); // it has left the window
  });
  useWindowEvent("drop", (event) => {
    setHeld(false);
    event.preventDefault();
    if (allowed && event.dataTransfer) onFiles(event.dataTransfer.files);
  });
  if (!held) return null;
  return (
    <div class="drop-zone">
      <p>
        <Icon of={Upload} size={28} />
        {allowed ? "Drop files to add scenes" : "This server does not accept uploads"}
      </p>
    </div>
  );
}
