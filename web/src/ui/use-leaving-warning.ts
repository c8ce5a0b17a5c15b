/** Has the browser ask who leaves the page whether what would be lost with it may be. */
import { useEffect } from "preact/hooks";

export function useLeavingWarning(needed: boolean): void {
  useEffect(() => {
    if (!needed) return undefined;
    const ask = (event: BeforeUnloadEvent) => event.preventDefault();
    addEventListener("beforeunload", ask);
    return () => removeEventListener("beforeunload", ask);
  }, [needed]);
}
