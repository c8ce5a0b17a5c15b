/** Accepts files dropped anywhere on the page, with a hint while they are dragged over it. */
import { useSignal } from "@preact/signals";
import { Upload } from "lucide";
import { useEffect } from "preact/hooks";
import { Icon } from "../icon";

interface Props {
  /** Whether the server accepts uploads. If not, the browser must not open the dropped file instead. */
  readonly allowed: boolean;
  readonly onFiles: (files: Iterable<File>) => void;
}

export function DropZone({ allowed, onFiles }: Props) {
  const held = useSignal(false);
  useEffect(() => {
    const over = (event: DragEvent) => {
      if (!event.dataTransfer?.types.includes("Files")) return;
      event.preventDefault();
      event.dataTransfer.dropEffect = allowed ? "copy" : "none";
      held.value = true;
    };
    const leave = (event: DragEvent) => {
      if (event.relatedTarget === null) held.value = false; // it has left the window
    };
    const drop = (event: DragEvent) => {
      held.value = false;
      event.preventDefault();
      if (allowed && event.dataTransfer) onFiles(event.dataTransfer.files);
    };
    addEventListener("dragover", over);
    addEventListener("dragleave", leave);
    addEventListener("drop", drop);
    return () => {
      removeEventListener("dragover", over);
      removeEventListener("dragleave", leave);
      removeEventListener("drop", drop);
    };
  }, [allowed, onFiles, held]);
  if (!held.value) return null;
  return (
    <div class="drop-zone">
      <p>
        <Icon of={Upload} size={28} />
        {allowed ? "Drop to add as scenes" : "This server takes no scenes from pages"}
      </p>
    </div>
  );
}
