import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { Shaper } from "#lab/network/shaper";

/** The shaper at a URL, while wanted; null without one. */
export function useShaper(base: string | undefined, wanted: boolean, plotted = false): Shaper | null {
  const shaper = useSignal<Shaper | null>(null);
  useEffect(() => {
    if (base === undefined || !wanted) return undefined;
    const current = new Shaper(base, location.href, { plotted });
    shaper.value = current;
    return () => {
      shaper.value = null;
      current.dispose();
    };
  }, [base, wanted, plotted, shaper]);
  return shaper.value;
}
