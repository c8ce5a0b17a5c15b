/** The movement of an experiment: from the store, or a file or recording of this visit. */

import { useSignal } from "@preact/signals";
import { FolderOpen } from "lucide";
import { useEffect, useMemo, useRef } from "preact/hooks";
import { MovementError, placeInScene, readMovementFile } from "../../movement/movement";
import { addFile, movements, type NamedMovement } from "../../movement/movement-deck";
import type { TimedPose } from "../../movement/playback";
import { fetchMovement } from "../../movement/stored-movements";
import type { SceneInfo } from "../../wire/render";
import { clock } from "../format";
import { Icon } from "../icon";
import { useStoredMovements } from "../use-stored-movements";
import { Select } from "./experiment-fields";

export interface ListedMovement extends Pick<NamedMovement, "origin" | "name"> {
  /** Value of the form's option. */
  readonly key: string;
  readonly duration: number;
}

/** Known movements of the store and of this visit, and the reason if the store's are missing. */
export function useMovements(store: string | undefined): { listed: readonly ListedMovement[]; silence: string | null } {
  const { stored, silence } = useStoredMovements(store);
  const ofVisit = movements.value.map(({ origin, name, trace }) => listed({ origin, name }, trace.duration));
  const ofStore = stored.map(({ name, duration_ms }) => listed({ origin: "store", name }, duration_ms));
  return { listed: [...ofStore, ...ofVisit], silence };
}

/** A movement's value in a form. */
export function keyOf({ origin, name }: Pick<NamedMovement, "origin" | "name">): string {
  return `${origin}/${name}`;
}

function listed({ origin, name }: Pick<NamedMovement, "origin" | "name">, duration: number): ListedMovement {
  return { key: keyOf({ origin, name }), origin, name, duration };
}

export interface OpenedMovement {
  readonly name: string;
  /** In the scene's own frame. */
  readonly points: readonly TimedPose[];
}

/** Opens the movement of a form. Closing the form cancels it. */
export function useMovementOpening(store: string | undefined) {
  const busy = useSignal(false);
  const closing = useMemo(() => new AbortController(), []);
  useEffect(() => () => closing.abort(), [closing]);
  /** Null if the form was closed meanwhile. Rejects with a MovementError. */
  const open = async (movement: ListedMovement, scene: SceneInfo): Promise<OpenedMovement | null> => {
    busy.value = true;
    try {
      const { name, trace } = await movementOf(movement, store, closing.signal);
      return { name, points: placeInScene(trace, scene) };
    } catch (error) {
      if (closing.signal.aborted) return null;
      throw error;
    } finally {
      busy.value = false;
    }
  };
  return { busy: busy.value, open };
}

/** A movement of the list. Rejects with a MovementError, or because `signal` was aborted. */
async function movementOf(
  { origin, name }: ListedMovement,
  store: string | undefined,
  signal: AbortSignal,
): Promise<NamedMovement> {
  const found = movements.peek().find((movement) => movement.origin === origin && movement.name === name);
  if (found) return found;
  if (store === undefined) throw new MovementError(`There is no movement ${name}.`);
  return fetchMovement(store, name, signal);
}

interface Props {
  readonly list: ReturnType<typeof useMovements>;
  readonly chosen: string | null;
  readonly onChoose: (key: string) => void;
  readonly onProblem: (sentence: string) => void;
}

export function MovementChoice({ list: { listed, silence }, chosen, onChoose, onProblem }: Props) {
  const input = useRef<HTMLInputElement>(null);
  const open = async (file: File) => {
    try {
      onChoose(keyOf(addFile(file.name, await readMovementFile(file))));
    } catch (error) {
      if (!(error instanceof MovementError)) throw error;
      onProblem(error.message);
    }
  };
  const known = listed.some(({ key }) => key === chosen);
  return (
    <>
      <Select label="Movement" value={known ? (chosen ?? "") : ""} onValue={onChoose} note={silence ?? undefined}>
        {!known && (
          <option value="" disabled selected>
            {listed.length > 0 ? "Choose one" : "None yet"}
          </option>
        )}
        {listed.map(({ key, name, duration }) => (
          <option key={key} value={key}>
            {name} · {clock(duration)}
          </option>
        ))}
      </Select>
      <div class="number-field">
        <span>&nbsp;</span>
        <button type="button" class="quiet-button with-icon" onClick={() => input.current?.click()}>
          <Icon of={FolderOpen} size={14} /> Open a file…
        </button>
        <input
          ref={input}
          type="file"
          hidden
          aria-label="Movement file of the experiment"
          accept=".csv,text/csv,text/plain"
          onChange={({ currentTarget }) => {
            const [file] = currentTarget.files ?? [];
            if (file) void open(file);
            currentTarget.value = ""; // the same file may be chosen again
          }}
        />
      </div>
    </>
  );
}
