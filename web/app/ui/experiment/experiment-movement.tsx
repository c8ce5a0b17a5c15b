/** The movement of an experiment: from the store, or a file or recording of this visit. */

import { addFile, movements } from "#viewer/movement/movement-deck";
import { readMovementFile, writeMovement } from "#viewer/movement/movement-file";
import { FileButton } from "../button";
import { Select } from "../fields";
import { clock } from "../format";
import { reason } from "../hooks";
import { keyOf, type ListedMovement, type useMovements } from "../use-movements";

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
  const open = async (file: File) => {
    try {
      onChoose(keyOf(addFile(file.name, await readMovementFile(file))));
    } catch (error) {
      onProblem(reason(error));
    }
  };
  const known = listed.some(({ key }) => key === chosen);
  return (
    <>
      <Select
        label="Movement"
        value={known ? (chosen ?? "") : ""}
        options={listed.map(({ key, name, duration }) => [key, `${name} · ${clock(duration)}`])}
        onValue={onChoose}
        note={silence}
      >
        {!known && (
          <option value="" disabled selected>
            {listed.length > 0 ? "Choose one" : "None yet"}
          </option>
        )}
      </Select>
      <div class="number-field small">
        <span>&nbsp;</span>
        <FileButton
          label="Movement file for the experiment"
          accept=".csv,text/csv,text/plain"
          onFile={(file) => void open(file)}
        >
          Open a file…
        </FileButton>
      </div>
    </>
  );
}
