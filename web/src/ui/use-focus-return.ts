/** After a click on a button the keys belong to the camera again; who came by keyboard keeps the focus. */
import type { RefObject } from "preact";
import { useEffect } from "preact/hooks";

export function useFocusReturn(root: RefObject<HTMLElement | null>, stage: RefObject<HTMLElement | null>): void {
  useEffect(() => {
    const element = root.current;
    const giveBack = (event: MouseEvent) => {
      const button = event.target instanceof Element && event.target.closest("button");
      const byPointer = event.detail > 0;
      if (button && byPointer && !button.closest("dialog")) stage.current?.focus({ preventScroll: true });
    };
    element?.addEventListener("click", giveBack);
    return () => element?.removeEventListener("click", giveBack);
  }, [root, stage]);
}
