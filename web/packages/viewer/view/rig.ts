/**
 * The camera, its lens and its pose: sampled once per animation frame, shown by every mode. Each changed pose gets a number,
 * so that any later frame can name the pose that it shows.
 */

import { computed, type ReadonlySignal, signal } from "@preact/signals";
import { Listeners } from "#client/async/listeners";
import type { SceneInfo } from "#client/wire/render";
import {
  ahead,
  approach,
  between,
  type Camera,
  fromScene,
  levelFor,
  type ScenePose,
  seenFrom,
  startCamera,
  toScene,
  viewDistance,
} from "./camera";
import { defaultIntrinsics, type Intrinsics, type Viewport, viewportFor } from "./intrinsics";
import { type InputSample, isMoving, type Speeds, step, suggestedSpeed } from "./motion";
import { angleBetween, conjugate, rotate, type Vector3 } from "./vector";

export interface NumberedPose extends ScenePose {
  /** Increases by one with each change. */
  readonly seq: number;
}

/** The camera's pose at a time (performance.now), in the scene's own frame; null when the source has ended. */
export type PoseSource = (now: number) => ScenePose | null;

export interface RigOptions {
  /** Input since the last sample, the given number of milliseconds ago. */
  readonly sampleInput: (elapsed: number) => InputSample;
  /** Degrees per second. */
  readonly turnSpeed: () => number;
}

/** Duration of a flight to a focus, in milliseconds. */
const FLIGHT = 500;
const ORIGIN: NumberedPose = { seq: 0, position: [0, 0, 0], quaternion: [0, 0, 0, 1] };

export class Rig {
  readonly viewport = signal<Viewport>({ width: 1, height: 1 });
  /** Intrinsics that the user set; the others follow the viewport. */
  readonly lens = signal<Partial<Intrinsics>>({});
  readonly intrinsics: ReadonlySignal<Intrinsics> = computed(() => ({
    ...defaultIntrinsics(this.viewport.value),
    ...this.lens.value,
  }));
  /** Scene units per second. */
  readonly moveSpeed = signal(1);
  readonly #options: RigOptions;
  readonly #samples = new Listeners<[pose: NumberedPose, at: number]>();
  /** Subscribes to every sample, its pose and time (performance.now); returns a function that unsubscribes. */
  readonly onSample = this.#samples.add;
  #scene: SceneInfo | undefined;
  #camera: Camera = { position: [0, 0, 0], azimuth: 0, elevation: 0 };
  readonly #source = signal<PoseSource | null>(null);
  /** Whether input that would move the camera ends the source. */
  #yields = false;
  /** Pivot of the orbit in the levelled frame; null for a point straight ahead. */
  #focus: Vector3 | null = null;
  /** A flight to a focus. */
  #flight: { readonly from: Camera; readonly to: Camera; at: number | null } | null = null;
  #pose = ORIGIN;
  #sampledAt = 0;
  #changedAt = 0;
  #turning = 0;
  #placements = 0;

  constructor(options: RigOptions) {
    this.#options = options;
  }

  /** The scene that it is in. */
  get scene(): SceneInfo | undefined {
    return this.#scene;
  }

  get pose(): NumberedPose {
    return this.#pose;
  }

  get changedAt(): number {
    return this.#changedAt;
  }

  /** How fast the camera turned at the last sample, in degrees per second. */
  get turning(): number {
    return this.#turning;
  }

  /** Number of cuts: earlier poses do not predict the camera after a cut. */
  get placements(): number {
    return this.#placements;
  }

  /** The source that it follows; null for the user. */
  get source(): ReadonlySignal<PoseSource | null> {
    return this.#source;
  }

  /** Moves the camera to a scene's start. */
  enter(scene: SceneInfo): void {
    this.#scene = scene;
    this.resetCamera();
    this.moveSpeed.value = suggestedSpeed(viewDistance(scene));
  }

  /** Takes a more complete description of the entered scene; the camera stays. */
  update(scene: SceneInfo): void {
    const up = this.#scene?.up;
    this.#scene = scene;
    if (up && up.join() !== scene.up.join()) this.place(toScene(this.#camera, levelFor(up)));
  }

  /** Returns the user's camera to the scene's start: a new pose, but no movement; a source keeps the pose meanwhile. */
  resetCamera(): void {
    if (this.#scene) this.#cut(startCamera(this.#scene), this.#scene);
  }

  /** Moves the user's camera to a pose of the scene at once, upright. */
  place(pose: ScenePose): void {
    if (this.#scene) this.#cut(fromScene(pose, levelFor(this.#scene.up)), this.#scene);
  }

  #cut(camera: Camera, { up }: SceneInfo): void {
    this.#camera = camera;
    this.#focus = this.#flight = null;
    if (this.#source.peek() !== null) return;
    this.#placements++;
    this.#pose = { seq: this.#pose.seq + 1, ...toScene(camera, levelFor(up)) };
  }

  /**
   * Goes halfway to a point of the scene's own frame and looks at it, at once or with a flight; drags then orbit that
   * point.
   */
  focus(point: Vector3, smooth: boolean): void {
    if (!this.#scene) return;
    this.#focus = rotate(conjugate(levelFor(this.#scene.up)), point);
    const to = approach(this.#camera, this.#focus);
    this.#flight = { from: smooth ? this.#camera : to, to, at: null };
  }

  /** Resizes the stage to this many CSS pixels. */
  resize(width: number, height: number): void {
    if (width < 1 || height < 1) return;
    const next = viewportFor(width, height);
    const before = this.viewport.peek();
    if (next.width !== before.width || next.height !== before.height) this.viewport.value = next;
  }

  /**
   * Follows a source instead of the user, until it ends or, if it `yields`, the user moves the camera; null returns the
   * camera to the user, where it was before.
   */
  drive(source: PoseSource | null, { yields = false } = {}): void {
    this.#placements++;
    this.#flight = null;
    this.#yields = source !== null && yields;
    this.#source.value = source;
  }

  /** Returns control to the user at the source's last pose, upright. */
  takeOver(): void {
    if (this.#scene) this.#camera = fromScene(this.#pose, levelFor(this.#scene.up));
    this.drive(null);
  }

  /** Called once per animation frame; returns whether the camera moved. */
  sample(now: number): boolean {
    const moved = this.#sample(now);
    this.#samples.tell(this.#pose, now);
    return moved;
  }

  #sample(now: number): boolean {
    const elapsed = now - this.#sampledAt;
    const input = this.#options.sampleInput(elapsed);
    this.#sampledAt = now;
    if (this.#yields && isMoving(input)) this.takeOver();
    const pose = this.#driven(now) ?? this.#walked(input, elapsed, now);
    this.#turning = 0;
    if (pose === null || samePose(pose, this.#pose)) return false;
    this.#turning = (angleBetween(pose.quaternion, this.#pose.quaternion) * 1000) / Math.max(1, elapsed);
    this.#pose = { seq: this.#pose.seq + 1, ...pose };
    this.#changedAt = now;
    return true;
  }

  #driven(now: number): ScenePose | null {
    const pose = this.#source.peek()?.(now) ?? null;
    if (pose === null && this.#source.peek() !== null) this.drive(null);
    return pose;
  }

  #walked({ axes, nudge }: InputSample, elapsed: number, now: number): ScenePose | null {
    if (!this.#scene) return null;
    const walked = step(this.#camera, axes, nudge, this.#speeds, elapsed, this.#pivot);
    if (walked !== this.#camera) this.#flight = null; // the user takes precedence
    this.#camera = this.#flown(now) ?? walked;
    return toScene(this.#camera, levelFor(this.#scene.up));
  }

  #flown(now: number): Camera | null {
    if (this.#flight === null) return null;
    const { from, to } = this.#flight;
    this.#flight.at ??= now;
    const share = from === to ? 1 : Math.min(1, (now - this.#flight.at) / FLIGHT);
    if (share === 1) this.#flight = null;
    return between(from, to, share * share * (3 - 2 * share));
  }

  /** The focus in the levelled frame, unless the camera has left it. */
  get #pivot(): Vector3 {
    if (this.#focus !== null && seenFrom(this.#camera, this.#focus)[2] > 0) return this.#focus;
    return ahead(this.#camera, this.#scene ? viewDistance(this.#scene) : 1);
  }

  get #speeds(): Speeds {
    return { turn: this.#options.turnSpeed(), move: this.moveSpeed.value };
  }
}

/** Whether two poses are equal, number by number. */
export function samePose(a: ScenePose, b: ScenePose): boolean {
  return (
    a.position.every((value, i) => value === b.position[i]) &&
    a.quaternion.every((value, i) => value === b.quaternion[i])
  );
}
