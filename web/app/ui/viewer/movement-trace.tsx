/** Movement traces: choose one, or record one; then the camera follows it. */
import { useSignal } from "@preact/signals";
import { Circle, Download, FolderOpen, Pause, Play, Square } from "lucide";
import { useRef } from "preact/hooks";
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
import { fetchMovement, type ListedMovement } from "#viewer/movement/stored-movements";
import { config } from "../../state/app";
import { clock } from "../format";
import { Icon } from "../icon";
import { save } from "../save";
import { useStoredMovements } from "../use-stored-movements";

interface Props {
  readonly deck: MovementDeck;
  readonly scene: SceneInfo | null;
}

type Listed = readonly ListedMovement[];

/** How many steps the arrow keys need from a movement's start to its end. */
const STEPS = 200;

export function MovementTrace({ deck, scene }: Props) {
  const store = config.value?.services.store;
  const { stored, silence } = useStoredMovements(store);
  const movement = deck.movement.value;
  const problem = deck.problem.value ?? silence;
  return (
    <div class="movement">
      <Choice deck={deck} store={store} listed={stored} />
      <OpenFile deck={deck} />
      {problem && (
        <p class="notice" role="alert">
          {problem}
        </p>
      )}
      {movement && <About movement={movement} scene={scene} />}
      {movement && <Progress deck={deck} movement={movement} />}
      <Buttons deck={deck} ready={scene !== null} />
      {movement && (
        <label class="check">
          <input
            type="checkbox"
            checked={deck.loop.value}
            onChange={(event) => {
              deck.loop.value = event.currentTarget.checked;
            }}
          />
          Start again at the end
        </label>
      )}
      <p class="muted small" data-movement={deck.state.value}>
        {describe(deck)}
      </p>
      {movement?.origin === "recording" && (
        <button type="button" class="quiet-button with-icon" onClick={() => saveCsv(movement)}>
          <Icon of={Download} size={14} /> Save as CSV
          {unsaved.value.has(movement) && <span class="muted">not saved yet</span>}
        </button>
      )}
    </div>
  );
}

/** The store's movements, and this visit's files and recordings. */
function Choice({ deck, store, listed }: Pick<Props, "deck"> & { store: string | undefined; listed: Listed }) {
  /** The name of the store's that is on its way. */
  const awaited = useSignal<string | null>(null);
  const chosen = awaited.value === null ? deck.movement.value : null;
  const ask = async (base: string, name: string) => {
    awaited.value = name;
    await deck.open((signal) => fetchMovement(base, name, signal));
    if (awaited.value === name) awaited.value = null;
  };
  if (listed.length + movements.value.length === 0) return null;
  return (
    <fieldset class="rungs traces" disabled={deck.state.value === "recording"}>
      <legend class="visually-hidden">Movement</legend>
      {store !== undefined &&
        listed.map(({ name, duration_ms, description }) => (
          <label key={`store ${name}`} title={description}>
            <input
              type="radio"
              name="movement"
              checked={name === awaited.value || (chosen?.origin === "store" && chosen.name === name)}
              onChange={() => void ask(store, name)}
            />
            <span class="trace-name">{name}</span>
            <span class="muted">{clock(duration_ms)}</span>
          </label>
        ))}
      {movements.value.map((movement) => (
        <label key={`${movement.origin} ${movement.name}`}>
          <input type="radio" name="movement" checked={movement === chosen} onChange={() => deck.insert(movement)} />
          <span class="trace-name">{movement.name}</span>
          <span class="muted">{clock(movement.trace.duration)}</span>
        </label>
      ))}
    </fieldset>
  );
}

function OpenFile({ deck }: { deck: MovementDeck }) {
  const input = useRef<HTMLInputElement>(null);
  return (
    <>
      <button
        type="button"
        class="quiet-button with-icon"
        title="Or drop a file anywhere on this page"
        disabled={deck.state.value === "recording"}
        onClick={() => input.current?.click()}
      >
        <Icon of={FolderOpen} size={14} /> Open a CSV file…
      </button>
      <input
        ref={input}
        type="file"
        hidden
        aria-label="Movement file"
        accept=".csv,text/csv,text/plain"
        onChange={({ currentTarget }) => {
          const [file] = currentTarget.files ?? [];
          if (file) void openFile(deck, file);
          currentTarget.value = ""; // the same file may be chosen again
        }}
      />
    </>
  );
}

function About({ movement: { trace }, scene }: { movement: NamedMovement; scene: SceneInfo | null }) {
  const from = trace.comments.get("scene");
  const description = trace.comments.get("description");
  const begins = trace.anchor === "start" ? "begins at the scene's start view" : "stands where it is in its scene";
  return (
    <>
      {description && <p class="small movement-about">{description}</p>}
      <p class="muted small">
        {trace.points.length.toLocaleString("en")} {trace.points.length === 1 ? "pose" : "poses"}; {begins}.
        {trace.anchor === "scene" && from && scene && from !== scene.id && ` That was “${from}”, not this scene.`}
      </p>
    </>
  );
}

function Progress({ deck, movement }: { deck: MovementDeck; movement: NamedMovement }) {
  const { duration } = movement.trace;
  const recording = deck.state.value === "recording";
  const at = recording ? 0 : deck.position.value;
  return (
    <div class="movement-progress">
      <input
        type="range"
        aria-label="Place in the movement"
        aria-valuetext={`${clock(at)} of ${clock(duration)}`}
        min={0}
        max={STEPS}
        step={1}
        value={duration > 0 ? (at / duration) * STEPS : 0}
        disabled={recording || deck.busy.value}
        onInput={(event) => deck.seek((event.currentTarget.valueAsNumber / STEPS) * duration)}
      />
      <output>
        {clock(at)} / {clock(duration)}
      </output>
    </div>
  );
}

function Buttons({ deck, ready }: { deck: MovementDeck; ready: boolean }) {
  const state = deck.state.value;
  const plays = state === "playing";
  return (
    <div class="playing">
      <button
        type="button"
        class="quiet-button"
        disabled={!ready || deck.movement.value === null || state === "recording" || deck.busy.value}
        onClick={() => (plays ? deck.pause() : deck.play())}
      >
        <Icon of={plays ? Pause : Play} size={14} /> {plays ? "Pause" : state === "paused" ? "Resume" : "Play"}
      </button>
      <button type="button" class="quiet-button" disabled={state === "stopped"} onClick={() => deck.stop()}>
        <Icon of={Square} size={14} /> Stop
      </button>
      <button
        type="button"
        class="quiet-button record"
        disabled={!ready || state === "recording"}
        onClick={() => deck.record()}
      >
        <Icon of={Circle} size={14} /> Record
      </button>
    </div>
  );
}

function describe(deck: MovementDeck): string {
  const states = {
    playing: "The movement has the camera, and your input waits. Stop or Esc gives it back, where it is then.",
    paused: "Paused: the camera stays, and your input waits. Stop or Esc gives it back, where it is then.",
    recording: `Recording the camera: ${clock(deck.position.value)}.`,
    stopped: deck.busy.value ? "Something else moves the camera now, such as an experiment." : idle(deck),
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
