/** Whether an element fills the screen, and the switch for it. */
import { useSignal } from "@preact/signals";
import type { RefObject } from "preact";
import { useEffect } from "preact/hooks";

export interface Fullscreen {
  readonly on: boolean;
  /** Null where the browser has none, as on iPhones. */
  readonly toggle: (() => void) | null;
}

export function useFullscreen(element: RefObject<HTMLElement | null>): Fullscreen {
  const on = useSignal(false);
  useEffect(() => {
    const follow = () => {
      on.value = document.fullscreenElement !== null;
    };
    document.addEventListener("fullscreenchange", follow);
    return () => document.removeEventListener("fullscreenchange", follow);
  }, [on]);
  return { on: on.value, toggle: document.fullscreenEnabled ? () => void toggle(element.current) : null };
}

async function toggle(element: HTMLElement | null): Promise<void> {
  try {
    await (document.fullscreenElement ? document.exitFullscreen() : element?.requestFullscreen());
  } catch {
    // refused: the stage fills the window as before
  }
}
