/** The viewer's keys that are not movement. */
import { useEffect, useRef } from "preact/hooks";

export interface ViewerActions {
  readonly help: () => void;
  readonly hud: () => void;
  readonly sidebar: () => void;
  readonly reset: () => void;
  readonly fullscreen: () => void;
  readonly mode: () => void;
  readonly experiment: () => void;
  readonly drag: () => void;
  readonly lock: () => void;
}

const KEYS: Readonly<Record<string, keyof ViewerActions>> = {
  h: "help",
  "?": "help",
  i: "hud",
  p: "sidebar",
  r: "reset",
  f: "fullscreen",
  m: "mode",
  x: "experiment",
  o: "drag",
  l: "lock",
};

const TYPING = "input:not([type=radio], [type=checkbox]), select, textarea, dialog";

/** `locked`: none of them does anything. */
export function useShortcuts(actions: ViewerActions, locked: boolean): void {
  const latest = useRef({ actions, locked });
  latest.current = { actions, locked };
  useEffect(() => {
    const press = (event: KeyboardEvent) => {
      const typing = event.target instanceof Element && event.target.closest(TYPING);
      const action = KEYS[event.key.toLowerCase()];
      if (!action || latest.current.locked || typing || event.repeat || event.ctrlKey || event.altKey || event.metaKey)
        return;
      event.preventDefault();
      latest.current.actions[action]();
    };
    addEventListener("keydown", press);
    return () => removeEventListener("keydown", press);
  }, []);
}
