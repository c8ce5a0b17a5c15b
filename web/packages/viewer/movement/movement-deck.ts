/**
 * Plays movement traces in the viewer and records the user's movement, like a tape deck: one thing at a time. The rig
 * follows a playing movement; stopping it continues from the camera's current pose. Time is part of the samples.
 */
import { computed, effect, type ReadonlySignal, type Signal, signal, untracked } from "@preact/signals";
import { ApiError } from "#client/http/problem";
import type { NumberedPose, PoseSource, Rig } from "../view/rig";
import type { CameraPath } from "./camera-path";
import {
  MAX_POINTS,
  MovementError,
  type MovementTrace,
  placeInScene,
  poseAt,
  type TimedPose,
  toLevelFrame,
} from "./movement";

export interface NamedMovement {
  readonly name: string;
  readonly origin: "file" | "recording" | "store";
  readonly trace: MovementTrace;
}

export type DeckState = "stopped" | "playing" | "paused" | "recording";

/** Update interval of the displayed position, in milliseconds. */
const TELL_EVERY = 100;

/** The files and recordings of this visit, for any scene. */
export const movements = signal<readonly NamedMovement[]>([]);
export const unsaved = signal<ReadonlySet<NamedMovement>>(new Set());

export class MovementDeck {
  /** Whether a movement restarts at its end. */
  readonly loop: Signal<boolean> = signal(false);
  /** Reason why the last requested movement is unavailable, in one sentence. */
  readonly problem: Signal<string | null> = signal(null);
  /** Whether something else moves the camera: a script, or an experiment. */
  readonly busy: ReadonlySignal<boolean>;
  readonly #rig: Rig;
  readonly #chosen: Signal<NamedMovement | null>;
  readonly #state = signal<DeckState>("stopped");
  readonly #position = signal(0);
  readonly #cleanups: (() => void)[];
  #opening = new AbortController();
  #points: readonly TimedPose[] = [];
  #recorded: TimedPose[] = [];
  #startedAt = 0;
  /** Position in the movement, to the microsecond. */
  #at = 0;
  /** Position that the camera has shown last. */
  #shown = -1;
  #sampledAt: number | null = null;

  /** `chosen` is the loaded movement. */
  constructor(rig: Rig, chosen: Signal<NamedMovement | null> = signal(null)) {
    this.#rig = rig;
    this.#chosen = chosen;
    this.busy = computed(() => rig.source.value !== null && rig.source.value !== this.#source);
    this.#cleanups = [
      rig.onSample((pose, at) => this.#sampled(pose, at)),
      effect(() => {
        const mine = rig.source.value === this.#source;
        untracked(() => !mine && this.#driving && this.#rest());
      }),
    ];
  }

  get state(): ReadonlySignal<DeckState> {
    return this.#state;
  }

  /** Position of playback, or length of the recording, in milliseconds; updated at intervals. */
  get position(): ReadonlySignal<number> {
    return this.#position;
  }

  get movement(): ReadonlySignal<NamedMovement | null> {
    return this.#chosen;
  }

  /** Loads a movement, unless another is requested meanwhile. A failure changes only `problem`. */
  async open(read: (signal: AbortSignal) => Promise<NamedMovement>): Promise<void> {
    this.#opening.abort();
    this.#opening = new AbortController();
    const { signal } = this.#opening;
    try {
      const movement = await read(signal);
      if (!signal.aborted) this.insert(movement);
    } catch (error) {
      if (signal.aborted) return;
      const known = error instanceof MovementError || error instanceof ApiError;
      this.problem.value = known ? error.message : "This movement is not available.";
    }
  }

  /** The chosen movement as a path in the current scene; null if either is missing. */
  get path(): CameraPath | null {
    const movement = this.#chosen.peek();
    const { scene } = this.#rig;
    if (!movement || !scene) return null;
    const points = placeInScene(movement.trace, scene);
    return { duration: movement.trace.duration, at: (time) => poseAt(points, time) };
  }

  /** Stops playback. */
  insert(movement: NamedMovement): void {
    this.stop();
    this.problem.value = null;
    this.#chosen.value = movement;
    this.#moveTo(0);
  }

  /** Plays from where it was paused, or from the start. */
  play(): void {
    if (this.#at >= (this.#chosen.peek()?.trace.duration ?? 0)) this.#moveTo(0);
    this.#follow("playing");
  }

  /** Pauses the movement; the camera stays where it is. */
  pause(): void {
    if (this.#driving) this.#state.value = "paused";
  }

  /** Seeks to a time in the movement, in milliseconds. */
  seek(at: number): void {
    const duration = this.#chosen.peek()?.trace.duration ?? 0;
    this.#moveTo(Math.min(Math.max(0, at), duration));
    if (!this.#driving) this.#follow("paused");
  }

  /** Ends playback or recording and returns the camera to the user, at its current pose. */
  stop(): void {
    if (this.#state.peek() === "recording") this.#keep();
    if (this.#driving) {
      this.#rig.takeOver();
      this.#moveTo(0);
    }
  }

  /** Records the camera's poses, from any source, until stopped. */
  record(): void {
    if (!this.#rig.scene || this.#state.peek() === "recording") return;
    this.stop();
    this.#recorded = [];
    this.#moveTo(0);
    this.#state.value = "recording";
  }

  /** Ends the recording and keeps it. */
  dispose(): void {
    this.#opening.abort();
    this.stop();
    for (const cleanup of this.#cleanups) cleanup();
  }

  get #driving(): boolean {
    return this.#state.peek() === "playing" || this.#state.peek() === "paused";
  }

  #follow(state: "playing" | "paused"): void {
    const { scene } = this.#rig;
    const movement = this.#chosen.peek();
    if (!scene || !movement || this.busy.peek() || this.#state.peek() === "recording") return;
    if (!this.#driving) {
      this.#points = placeInScene(movement.trace, scene);
      this.#sampledAt = null;
      this.#shown = -1;
    }
    this.#state.value = state;
    this.#rig.drive(this.#source);
  }

  /** The pose that is due; at the end, the user gets the camera back. */
  readonly #source: PoseSource = (now) => {
    const elapsed = now - (this.#sampledAt ?? now);
    this.#sampledAt = now;
    const duration = this.#points.at(-1)?.t_ms ?? 0;
    if (this.#state.peek() === "playing") {
      if (this.#shown >= duration && this.#at >= duration && !this.loop.peek()) {
        this.#moveTo(duration);
        this.#rig.takeOver();
        return null;
      }
      const at = this.#at + elapsed;
      const again = this.loop.peek() && at >= duration && duration > 0;
      this.#tell(again ? at % duration : Math.min(at, duration));
    }
    this.#shown = this.#at;
    return poseAt(this.#points, this.#at);
  };

  /** Keeps every sample, so that pauses are preserved. */
  #sampled({ position, quaternion }: NumberedPose, at: number): void {
    const { scene } = this.#rig;
    if (this.#state.peek() !== "recording" || !scene) return;
    if (this.#recorded.length === 0) this.#startedAt = at;
    const t_ms = at - this.#startedAt;
    if (t_ms <= (this.#recorded.at(-1)?.t_ms ?? -1)) return; // a coarse clock
    this.#recorded.push({ t_ms, ...toLevelFrame({ position, quaternion }, scene) });
    this.#tell(t_ms);
    if (this.#recorded.length === MAX_POINTS) this.#keep();
  }

  #keep(): void {
    this.#rest();
    const scene = this.#rig.scene?.id ?? "";
    const points = this.#recorded;
    this.#recorded = [];
    const duration = points.at(-1)?.t_ms;
    if (duration === undefined) return;
    const number = movements.peek().filter(({ origin }) => origin === "recording").length + 1;
    const comments = new Map([
      ["description", `Recorded in the page, in the scene ${scene}`],
      ["scene", scene],
      ["recorded", new Date().toISOString()],
    ]);
    const trace: MovementTrace = { anchor: "scene", unit: "scene", comments, points, duration };
    const movement: NamedMovement = { name: `Recording ${number}`, origin: "recording", trace };
    movements.value = [...movements.peek(), movement];
    unsaved.value = new Set([...unsaved.peek(), movement]);
    this.#chosen.value = movement;
    this.#moveTo(0);
  }

  #rest(): void {
    this.#state.value = "stopped";
  }

  #moveTo(at: number): void {
    this.#tell(at, true);
  }

  #tell(at: number, now = false): void {
    this.#at = at;
    if (now || Math.abs(at - this.#position.peek()) >= TELL_EVERY) this.#position.value = at;
  }
}

/** Adds a file's movement to this visit's; reading the same file again replaces it. */
export function addFile(name: string, trace: MovementTrace): NamedMovement {
  const movement: NamedMovement = { name, origin: "file", trace };
  const others = movements.peek().filter((other) => other.name !== name || other.origin !== "file");
  movements.value = [...others, movement];
  return movement;
}

/** Records that a movement has been saved to disk. */
export function markSaved(movement: NamedMovement): void {
  unsaved.value = new Set([...unsaved.peek()].filter((other) => other !== movement));
}
