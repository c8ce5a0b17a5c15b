/** Whether an element fills the screen, and the switch for it. */
import { useSignal } from "@preact/signals";
import type { RefObject } from "preact";
import { useEffect } from "preact/hooks";

export interface Fullscreen {
  readonly on: boolean;
  readonly toggle: () => void;
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
  return { on: on.value, toggle: () => void toggle(element.current) };
}

async function toggle(element: HTMLElement | null): Promise<void> {
  try {
    await (document.fullscreenElement ? document.exitFullscreen() : element?.requestFullscreen());
  } catch {
    // phones that have no fullscreen for pages: the frame fills the window as it is
  }
}
