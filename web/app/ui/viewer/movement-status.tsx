/** Shown over the stage while a movement controls the camera or is recorded, with buttons to stop it. */

import { Circle, Pause, Play, Route, Square } from "lucide";
import type { MovementDeck } from "#viewer/movement/movement-deck";
import { changeSettings } from "../../state/app";
import { Icon, IconButton } from "../button";
import { clock } from "../format";
import { useWindowEvent } from "../hooks";

/** In a view without controls, it shows nothing and ignores keys and files. */
export function MovementStatus({ deck, bare }: { deck: MovementDeck; bare: boolean }) {
  useWindowEvent("keydown", (event) => {
    const plays = deck.state.peek() === "playing" || deck.state.peek() === "paused";
    if (event.key === "Escape" && plays && !bare && !inDialog(event)) deck.stop();
  });
  useDrop(bare ? null : deck);
  const state = deck.state.value;
  if (bare || state === "stopped") return null;
  const at = clock(deck.position.value);
  const duration = clock(deck.movement.value?.trace.duration ?? 0);
  return (
    <div class="floating movement-status row small" data-state={state}>
      <Icon of={state === "recording" ? Circle : Route} size={16} />
      <p role="status">
        {state === "recording" ? "Recording" : deck.movement.value?.name}
        {state !== "recording" && (
          <small class="muted">
            Your input is ignored<span class="by-key">; press Esc to take over</span>
          </small>
        )}
      </p>
      <output aria-live="off">{state === "recording" ? at : `${at} / ${duration}`}</output>
      {state !== "recording" && (
        <IconButton
          icon={state === "playing" ? Pause : Play}
          label={state === "playing" ? "Pause the movement" : "Resume the movement"}
          onClick={() => (state === "playing" ? deck.pause() : deck.play())}
        />
      )}
      <IconButton
        icon={Square}
        label={state === "recording" ? "Stop recording" : "Stop the movement"}
        onClick={() => deck.stop()}
      />
    </div>
  );
}

/** Opens a file that is dropped anywhere and shows the result in the lab. Without a deck, the file is ignored. */
function useDrop(deck: MovementDeck | null): void {
  const hasFile = (event: DragEvent) => Boolean(event.dataTransfer?.types.includes("Files")) && !inDialog(event);
  useWindowEvent("dragover", (event) => hasFile(event) && event.preventDefault());
  useWindowEvent("drop", (event) => {
    const [file] = event.dataTransfer?.files ?? [];
    if (!hasFile(event) || !file) return;
    event.preventDefault(); // the browser would show the file instead of the page
    if (!deck) return;
    changeSettings({ sidebar: true });
    void import("./movement-trace").then(({ openFile }) => openFile(deck, file));
  });
}

function inDialog({ target }: Event): boolean {
  return target instanceof Element && target.closest("dialog") !== null;
}
