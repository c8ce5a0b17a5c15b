/** The movements to choose from: the store's, requested when a component is first shown, and this visit's. */
import { useEffect, useState } from "preact/hooks";
import { ApiError } from "#client/http/problem";
import { movements, type NamedMovement } from "#viewer/movement/movement-deck";
import { listMovements, type ListedMovement as Stored } from "#viewer/movement/stored-movements";

export interface ListedMovement extends Pick<NamedMovement, "origin" | "name"> {
  /** Value of the movement in a form. */
  readonly key: string;
  readonly duration: number;
  readonly description?: string;
}

/** `store` is the store's URL; `silence` is the reason why its movements are unknown, in one sentence. */
export function useMovements(store: string | undefined): {
  readonly listed: readonly ListedMovement[];
  readonly silence: string | null;
} {
  const [stored, setStored] = useState<readonly Stored[]>([]);
  const [silence, setSilence] = useState<string | null>(null);
  useEffect(() => {
    if (store === undefined) return undefined;
    const asking = new AbortController();
    listMovements(store, asking.signal).then(
      (list) => {
        setStored(list);
        setSilence(null);
      },
      (error: unknown) => error instanceof ApiError && setSilence(error.message),
    );
    return () => asking.abort();
  }, [store]);
  const ofStore = stored.map(({ name, duration_ms, description }) => ({
    ...listed({ origin: "store", name }, duration_ms),
    description,
  }));
  const ofVisit = movements.value.map((movement) => listed(movement, movement.trace.duration));
  return { listed: [...ofStore, ...ofVisit], silence };
}

export function keyOf({ origin, name }: Pick<NamedMovement, "origin" | "name">): string {
  return `${origin}/${name}`;
}

function listed({ origin, name }: Pick<NamedMovement, "origin" | "name">, duration: number): ListedMovement {
  return { key: keyOf({ origin, name }), origin, name, duration };
}
