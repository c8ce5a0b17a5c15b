/** Whether the window has room for a sidebar beside the stage. The styles use the same width. */
import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";

const WIDE = "(min-width: 800px)";

export function useWide(): boolean {
  const wide = useSignal(matchMedia(WIDE).matches);
  useEffect(() => {
    const query = matchMedia(WIDE);
    const follow = () => {
      wide.value = query.matches;
    };
    query.addEventListener("change", follow);
    return () => query.removeEventListener("change", follow);
  }, [wide]);
  return wide.value;
}
