/** Over the stage, whether the settings are open or not: that a movement has the camera or is recorded, and how to stop it. */

import { Circle, Pause, Play, Route, Square } from "lucide";
import { useEffect } from "preact/hooks";
import type { MovementDeck } from "#viewer/movement/movement-deck";
import { changeSettings } from "../../state/app";
import { clock } from "../format";
import { Icon } from "../icon";
import { IconButton } from "../icon-button";

export function MovementStatus({ deck }: { deck: MovementDeck }) {
  useEscape(deck);
  useDrop(deck);
  const state = deck.state.value;
  if (state === "stopped") return null;
  const at = clock(deck.position.value);
  const duration = clock(deck.movement.value?.trace.duration ?? 0);
  return (
    <div class="floating movement-status" data-state={state}>
      <Icon of={state === "recording" ? Circle : Route} size={16} />
      <p role="status">
        {state === "recording" ? "Recording" : deck.movement.value?.name}
        {state !== "recording" && (
          <small class="muted">
            Your input waits<span class="by-key">; Esc gives the camera back</span>
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

function useEscape(deck: MovementDeck): void {
  useEffect(() => {
    const press = (event: KeyboardEvent) => {
      const plays = deck.state.peek() === "playing" || deck.state.peek() === "paused";
      if (event.key === "Escape" && plays && !inDialog(event)) deck.stop();
    };
    addEventListener("keydown", press);
    return () => removeEventListener("keydown", press);
  }, [deck]);
}

/** A file may be dropped anywhere; the settings show the result. */
function useDrop(deck: MovementDeck): void {
  useEffect(() => {
    const listening = new AbortController();
    const { signal } = listening;
    const hasFile = (event: DragEvent) => Boolean(event.dataTransfer?.types.includes("Files")) && !inDialog(event);
    addEventListener("dragover", (event) => hasFile(event) && event.preventDefault(), { signal });
    addEventListener(
      "drop",
      (event) => {
        const [file] = event.dataTransfer?.files ?? [];
        if (!hasFile(event) || !file) return;
        event.preventDefault(); // the browser would show the file instead of the page
        changeSettings({ sidebar: true });
        void import("./movement-trace").then(({ openFile }) => openFile(deck, file));
      },
      { signal },
    );
    return () => listening.abort();
  }, [deck]);
}

function inDialog({ target }: Event): boolean {
  return target instanceof Element && target.closest("dialog") !== null;
}
