/** Whether a media query matches at present. */
import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";

/** The window is wide enough for a sidebar next to the stage, which excludes phones in landscape. */
export const WIDE = "(min-width: 800px) and (min-height: 500px)";
export const TOUCH = "(pointer: coarse)";

export function useMedia(condition: string): boolean {
  const matches = useSignal(matchMedia(condition).matches);
  useEffect(() => {
    const query = matchMedia(condition);
    const follow = () => {
      matches.value = query.matches;
    };
    query.addEventListener("change", follow);
    return () => query.removeEventListener("change", follow);
  }, [condition, matches]);
  return matches.value;
}
