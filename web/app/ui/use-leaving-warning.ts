/** Makes the browser confirm leaving the page while unsaved work would be lost. */
import { useEffect } from "preact/hooks";

export function useLeavingWarning(needed: boolean): void {
  useEffect(() => {
    if (!needed) return undefined;
    const ask = (event: BeforeUnloadEvent) => event.preventDefault();
    addEventListener("beforeunload", ask);
    return () => removeEventListener("beforeunload", ask);
  }, [needed]);
}
