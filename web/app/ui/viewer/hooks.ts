/** Hooks of the viewer: shortcuts, focus, fullscreen, and pictures of the view. */
import { useSignal } from "@preact/signals";
import type { RefObject } from "preact";
import { useEffect, useState } from "preact/hooks";
import { TYPING } from "#viewer/input/stage-input";
import type { ViewerSession } from "#viewer/session/session";
import { settings } from "../../state/app";
import { reason, useWindowEvent } from "../hooks";
import { fileName, save } from "../save";

export interface ViewerActions {
  readonly help: () => void;
  readonly hud: () => void;
  readonly sidebar: () => void;
  readonly reset: () => void;
  /** Null where the browser has no fullscreen. */
  readonly fullscreen: (() => void) | null;
  readonly mode: () => void;
  readonly experiment: () => void;
  readonly drag: () => void;
  readonly screenshot: () => void;
  readonly lock: () => void;
}

/** By position, like the movement keys: by letter, the two would collide on Colemak and Dvorak. */
const KEYS: Readonly<Record<string, keyof ViewerActions>> = {
  KeyH: "help",
  KeyI: "hud",
  KeyP: "sidebar",
  KeyR: "reset",
  KeyF: "fullscreen",
  KeyM: "mode",
  KeyX: "experiment",
  KeyO: "drag",
  KeyT: "screenshot",
  KeyL: "lock",
};

/** The action of a key. The question mark is matched by character, since its key depends on the layout. */
export function actionOf({ key, code }: Pick<KeyboardEvent, "key" | "code">): keyof ViewerActions | undefined {
  return ["?", "؟", "？"].includes(key) ? "help" : KEYS[code];
}

/** Shortcuts are disabled while `locked`, and by the setting `shortcuts`. */
export function useShortcuts(actions: ViewerActions, locked: boolean): void {
  useWindowEvent("keydown", (event) => {
    const typing = event.target instanceof Element && event.target.closest(TYPING);
    const action = actionOf(event);
    const off = locked || !settings.peek().shortcuts;
    if (!action || off || typing || event.repeat || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    actions[action]?.();
  });
}

const SWITCHES = "select, input[type=radio], input[type=checkbox]";

/** Returns the focus to the stage after pointer use; keyboard users keep their focus while its element exists. */
export function useFocusReturn(root: RefObject<HTMLElement | null>, stage: RefObject<HTMLElement | null>): void {
  useEffect(() => {
    const element = root.current;
    if (!element) return undefined;
    const listening = new AbortController();
    const { signal } = listening;
    let byPointer = false;
    const giveBack = () => stage.current?.focus({ preventScroll: true });
    const remember = ({ type }: Event) => {
      byPointer = type === "pointerdown";
    };
    addEventListener("pointerdown", remember, { signal, capture: true });
    addEventListener("keydown", remember, { signal, capture: true });
    element.addEventListener(
      "click",
      (event) => {
        const button = event.target instanceof Element && event.target.closest("button");
        if (byPointer && button && !button.closest("dialog")) giveBack();
      },
      { signal },
    );
    element.addEventListener(
      "change",
      (event) => {
        if (byPointer && event.target instanceof Element && event.target.matches(SWITCHES)) giveBack();
      },
      { signal },
    );
    addEventListener("keyup", () => document.activeElement === document.body && giveBack(), { signal });
    return () => listening.abort();
  }, [root, stage]);
}

/** Whether an element fills the screen, and a function that toggles this; null without fullscreen, as on iPhones. */
export function useFullscreen(element: RefObject<HTMLElement | null>) {
  const [on, setOn] = useState(false);
  useEffect(() => {
    const follow = () => setOn(document.fullscreenElement !== null);
    document.addEventListener("fullscreenchange", follow);
    return () => document.removeEventListener("fullscreenchange", follow);
  }, []);
  return { on, toggle: document.fullscreenEnabled ? () => void toggle(element.current) : null };
}

async function toggle(element: HTMLElement | null): Promise<void> {
  try {
    await (document.fullscreenElement ? document.exitFullscreen() : element?.requestFullscreen());
  } catch {
    // refused: the stage fills the window as before
  }
}

/** Saves the current view as a picture at full quality. `problem` is the reason why the last one failed, or null. */
export function useScreenshot(session: ViewerSession | null) {
  const busy = useSignal(false);
  const problem = useSignal<string | null>(null);
  const take = async () => {
    if (session === null || busy.peek()) return;
    busy.value = true;
    problem.value = null;
    try {
      const { screenshot } = await import("#viewer/control/screenshot");
      save(fileName(session.scene.peek()?.name ?? "view", "png"), await screenshot(session));
    } catch (error) {
      problem.value = `The picture could not be saved. ${reason(error)}`;
    } finally {
      busy.value = false;
    }
  };
  return { busy: busy.value, problem: problem.value, take: () => void take() };
}
