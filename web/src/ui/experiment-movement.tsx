/** The movement of an experiment: one of the store's, or a file or recording of this visit. */
import { useSignal } from "@preact/signals";
import { FolderOpen } from "lucide";
import { useEffect, useRef } from "preact/hooks";
import { MovementError, type MovementTrace, readMovement, readMovementFile } from "../experiment/movement";
import { addFile, movements } from "../experiment/movement-deck";
import { fetchMovement, type ListedMovement, listMovements } from "../experiment/movements";
import { clock } from "../state/format";
import { Select } from "./experiment-fields";
import { Icon } from "./icon";

export interface Listed {
  /** What the form knows it by. */
  readonly key: string;
  readonly name: string;
  readonly duration: number;
}

/** The store's movements and this visit's, as far as they are known, and why the store's are not. */
export function useMovements(store: string | undefined): { listed: readonly Listed[]; silence: string | null } {
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
  const visit = movements.value.map(({ origin, name, trace }) => ({
    key: `${origin}/${name}`,
    name,
    duration: trace.duration,
  }));
  const kept = stored.value.map(({ name, duration_ms }) => ({ key: `store/${name}`, name, duration: duration_ms }));
  return { listed: [...kept, ...visit], silence: silence.value };
}

/** The movement that a key names. Rejects with a MovementError. */
export async function openMovement(
  key: string,
  store: string | undefined,
): Promise<{ readonly name: string; readonly trace: MovementTrace }> {
  const found = movements.peek().find(({ origin, name }) => `${origin}/${name}` === key);
  if (found) return found;
  const name = key.slice(key.indexOf("/") + 1);
  if (store === undefined) throw new MovementError(`There is no movement ${name}.`);
  return { name, trace: readMovement(await fetchMovement(store, name), name) };
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
      const { origin, name } = addFile(file.name, await readMovementFile(file));
      onChoose(`${origin}/${name}`);
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
          <option value="" disabled>
            {listed.length > 0 ? "Choose one" : "Open a file"}
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
