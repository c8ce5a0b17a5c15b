/** The viewer's keyboard shortcuts, apart from movement. */
import { useEffect, useRef } from "preact/hooks";
import { settings } from "../../state/app";

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

/** By position, as the movement keys are: by letter, the two would collide on Colemak and Dvorak. */
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

const TYPING = "input:not([type=radio], [type=checkbox]), select, textarea, dialog";

/** The action of a key. The question mark is matched by character, since its key depends on the layout. */
export function actionOf({ key, code }: Pick<KeyboardEvent, "key" | "code">): keyof ViewerActions | undefined {
  return ["?", "؟", "？"].includes(key) ? "help" : KEYS[code];
}

/** While `locked`, shortcuts are disabled, as they are for users who switched single keys off. */
export function useShortcuts(actions: ViewerActions, locked: boolean): void {
  const latest = useRef({ actions, locked });
  latest.current = { actions, locked };
  useEffect(() => {
    const press = (event: KeyboardEvent) => {
      const typing = event.target instanceof Element && event.target.closest(TYPING);
      const action = actionOf(event);
      const off = latest.current.locked || !settings.peek().shortcuts;
      if (!action || off || typing || event.repeat || event.ctrlKey || event.altKey || event.metaKey) return;
      event.preventDefault();
      latest.current.actions[action]?.();
    };
    addEventListener("keydown", press);
    return () => removeEventListener("keydown", press);
  }, []);
}
