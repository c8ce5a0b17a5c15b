/** Movement traces: choose or record one for the camera to follow. */
import { Circle, Download, Pause, Play, Square } from "lucide";
import { useState } from "preact/hooks";
import type { SceneInfo } from "#client/wire/render";
import {
  addFile,
  type MovementDeck,
  markSaved,
  movements,
  type NamedMovement,
  unsaved,
} from "#viewer/movement/movement-deck";
import { readMovementFile, writeMovement } from "#viewer/movement/movement-file";
import { fetchMovement } from "#viewer/movement/stored-movements";
import { config } from "../../state/app";
import { FileButton, QuietButton } from "../button";
import { Check, RadioList, Seek } from "../fields";
import { clock } from "../format";
import { Notice } from "../notice";
import { save } from "../save";
import { keyOf, type ListedMovement, useMovements } from "../use-movements";

interface Props {
  readonly deck: MovementDeck;
  readonly scene: SceneInfo | null;
}

export function MovementTrace({ deck, scene }: Props) {
  const store = config.value?.services.store;
  const { listed, silence } = useMovements(store);
  const movement = deck.movement.value;
  const problem = deck.problem.value ?? silence;
  const recording = deck.state.value === "recording";
  return (
    <div class="movement stack">
      <Choice deck={deck} store={store} listed={listed} />
      <FileButton
        label="Movement file"
        title="Or drop a file anywhere on this page"
        accept=".csv,text/csv,text/plain"
        disabled={recording}
        onFile={(file) => void openFile(deck, file)}
      >
        Open a CSV file…
      </FileButton>
      <Notice>{problem}</Notice>
      {movement && <About movement={movement} scene={scene} />}
      {movement && (
        <Seek
          label="Position in the movement"
          at={recording ? 0 : deck.position.value}
          duration={movement.trace.duration}
          disabled={recording || deck.busy.value}
          onSeek={(at) => deck.seek(at)}
        />
      )}
      <Buttons deck={deck} ready={scene !== null} />
      {movement && (
        <Check
          checked={deck.loop.value}
          onChange={() => {
            deck.loop.value = !deck.loop.value;
          }}
        >
          Loop
        </Check>
      )}
      <p class="muted small" data-movement={deck.state.value}>
        {describe(deck)}
      </p>
      {movement?.origin === "recording" && (
        <QuietButton icon={Download} onClick={() => saveCsv(movement)}>
          Save as CSV {unsaved.value.has(movement) && <span class="muted">not saved yet</span>}
        </QuietButton>
      )}
    </div>
  );
}

interface ChoiceProps extends Pick<Props, "deck"> {
  readonly store: string | undefined;
  readonly listed: readonly ListedMovement[];
}

/** The store's movements, and this visit's files and recordings. */
function Choice({ deck, store, listed }: ChoiceProps) {
  /** The key of the store's movement that is loading. */
  const [awaited, setAwaited] = useState<string | null>(null);
  const present = deck.movement.value;
  const choose = async (key: string) => {
    const stored = listed.find((one) => one.key === key && one.origin === "store");
    const own = movements.peek().find((movement) => keyOf(movement) === key);
    if (own) deck.insert(own);
    if (!stored || store === undefined) return;
    setAwaited(key);
    await deck.open((signal) => fetchMovement(store, stored.name, signal));
    setAwaited((newest) => (newest === key ? null : newest));
  };
  if (listed.length === 0) return null;
  return (
    <RadioList
      name="movement"
      label="Movement"
      boxed
      disabled={deck.state.value === "recording"}
      rows={listed.map(({ key, name, duration, description }) => ({
        key,
        title: name,
        detail: clock(duration),
        tooltip: description,
      }))}
      chosen={awaited ?? (present && keyOf(present))}
      onChoose={(key) => void choose(key)}
    />
  );
}

function About({ movement: { trace }, scene }: { movement: NamedMovement; scene: SceneInfo | null }) {
  const from = trace.comments.get("scene");
  const description = trace.comments.get("description");
  const begins = trace.anchor === "start" ? "starts at the scene's start view" : "stays where it was recorded";
  return (
    <>
      {description && <p class="small">{description}</p>}
      <p class="muted small">
        {trace.points.length.toLocaleString("en")} {trace.points.length === 1 ? "pose" : "poses"}; {begins}.
        {trace.anchor === "scene" && from && scene && from !== scene.id && ` It was recorded in “${from}”.`}
      </p>
    </>
  );
}

function Buttons({ deck, ready }: { deck: MovementDeck; ready: boolean }) {
  const state = deck.state.value;
  const plays = state === "playing";
  return (
    <div class="playing">
      <QuietButton
        icon={plays ? Pause : Play}
        disabled={!ready || deck.movement.value === null || state === "recording" || deck.busy.value}
        onClick={() => (plays ? deck.pause() : deck.play())}
      >
        {plays ? "Pause" : state === "paused" ? "Resume" : "Play"}
      </QuietButton>
      <QuietButton icon={Square} disabled={state === "stopped"} onClick={() => deck.stop()}>
        Stop
      </QuietButton>
      <QuietButton icon={Circle} kind="record" disabled={!ready || state === "recording"} onClick={() => deck.record()}>
        Record
      </QuietButton>
    </div>
  );
}

function describe(deck: MovementDeck): string {
  const states = {
    playing: "The movement controls the camera, and your input is ignored. Press Stop or Esc to take over.",
    paused: "Paused. Your input is still ignored; press Stop or Esc to take over.",
    recording: `Recording the camera: ${clock(deck.position.value)}.`,
    stopped: deck.busy.value ? "Something else is moving the camera, such as an experiment." : idle(deck),
  };
  return states[deck.state.value];
}

function idle(deck: MovementDeck): string {
  return deck.movement.value ? "" : "Play back a recorded movement, or record your own.";
}

export function openFile(deck: MovementDeck, file: File): Promise<void> {
  return deck.open(async () => addFile(file.name, await readMovementFile(file)));
}

function saveCsv(movement: NamedMovement): void {
  const { trace } = movement;
  const recorded = trace.comments.get("recorded")?.replace(/[:.]/g, "-");
  const name = `movement-${trace.comments.get("scene")}-${recorded}.csv`;
  save(name, new Blob([writeMovement(trace)], { type: "text/csv" }));
  markSaved(movement);
}
