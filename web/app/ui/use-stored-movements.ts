/** The store's list of movements, requested when a component is first shown. */
import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { MovementError } from "#viewer/movement/movement";
import { type ListedMovement, listMovements } from "#viewer/movement/stored-movements";

interface StoredMovements {
  /** Empty without a store, and while it is silent. */
  readonly stored: readonly ListedMovement[];
  /** Why the store's are not known, in one sentence. */
  readonly silence: string | null;
}

/** `store` is the store's URL. */
export function useStoredMovements(store: string | undefined): StoredMovements {
  const stored = useSignal<readonly ListedMovement[]>([]);
  const silence = useSignal<string | null>(null);
  useEffect(() => {
    if (store === undefined) return undefined;
    const asking = new AbortController();
    listMovements(store, asking.signal).then(
      (list) => {
        stored.value = list;
        silence.value = null;
      },
      (error: unknown) => {
        if (error instanceof MovementError) silence.value = error.message;
      },
    );
    return () => asking.abort();
  }, [store, stored, silence]);
  return { stored: stored.value, silence: silence.value };
}
