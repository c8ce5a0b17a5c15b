/** Returns the keyboard to the camera after pointer use; keyboard users keep their focus while its element exists. */
import type { RefObject } from "preact";
import { useEffect } from "preact/hooks";

const SWITCHES = "select, input[type=radio], input[type=checkbox]";

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
