/** The movement of an experiment: from the store, or a file or recording of this visit. */

import { FolderOpen } from "lucide";
import { useRef } from "preact/hooks";
import { MovementError } from "#viewer/movement/movement";
import { addFile, movements, type NamedMovement } from "#viewer/movement/movement-deck";
import { readMovementFile, writeMovement } from "#viewer/movement/movement-file";
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

/** The movement's name in an experiment's file, and its text unless the store has it. */
export function movementFile({ origin, name }: ListedMovement): {
  readonly name: string;
  readonly text: string | null;
} {
  const found = movements.peek().find((movement) => movement.origin === origin && movement.name === name);
  if (!found) return { name: `${name}.csv`, text: null };
  const file = name.replace(/[/\\]/g, "-");
  return { name: file.endsWith(".csv") ? file : `${file}.csv`, text: writeMovement(found.trace) };
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
