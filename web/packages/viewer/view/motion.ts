/** Turns the input since the last sample into a new camera. Pure: the elapsed time is an argument. */
import { type Camera, move, orbit, turn } from "./camera";
import type { Vector3 } from "./vector";

/** Current input to the camera, each from -1 to 1. */
export interface Axes {
  readonly forward: number;
  readonly right: number;
  readonly up: number;
  readonly turnRight: number;
  readonly turnUp: number;
  /** Factor of the walking speed; 1 if absent. */
  readonly haste?: number;
}

export interface Speeds {
  /** Degrees per second. */
  readonly turn: number;
  /** Scene units per second. */
  readonly move: number;
}

export interface Nudge {
  /** Rotation in degrees. */
  readonly turnRight: number;
  readonly turnUp: number;
  /** Rotation about the pivot, in degrees. */
  readonly orbitRight: number;
  readonly orbitUp: number;
  /** Movement in seconds of walking. */
  readonly forward: number;
  readonly right: number;
  readonly up: number;
}

export const NO_NUDGE: Nudge = { turnRight: 0, turnUp: 0, orbitRight: 0, orbitUp: 0, forward: 0, right: 0, up: 0 };

export interface InputSample {
  readonly axes: Axes;
  readonly nudge: Nudge;
}

export const NO_INPUT: InputSample = {
  axes: { forward: 0, right: 0, up: 0, turnRight: 0, turnUp: 0 },
  nudge: NO_NUDGE,
};

/** Whether input moves or turns the camera. */
export function isMoving({ axes: { haste: _, ...axes }, nudge }: InputSample): boolean {
  return [...Object.values(axes), ...Object.values(nudge)].some((amount) => amount !== 0);
}

/** After a pause (a hidden page, a slow machine) the camera continues without a jump (ms). */
const LONGEST_STEP = 100;

/** The camera after `elapsed` milliseconds, which may orbit a pivot. The same object if there was no input. */
export function step(
  camera: Camera,
  axes: Axes,
  nudge: Nudge,
  speeds: Speeds,
  elapsed: number,
  pivot: Vector3 = camera.position,
): Camera {
  const seconds = Math.min(LONGEST_STEP, Math.max(0, elapsed)) / 1000;
  // Walking diagonally is not faster than walking straight.
  const diagonal = Math.max(1, Math.hypot(axes.forward, axes.right));
  const haste = axes.haste ?? 1;
  const walk = (axis: number, once: number) => ((axis / diagonal) * seconds * haste + once) * speeds.move;
  const forward = walk(axes.forward, nudge.forward);
  const right = walk(axes.right, nudge.right);
  const up = (axes.up * seconds * haste + nudge.up) * speeds.move;
  const turnRight = axes.turnRight * seconds * speeds.turn + nudge.turnRight;
  const turnUp = axes.turnUp * seconds * speeds.turn + nudge.turnUp;
  const { orbitRight, orbitUp } = nudge;
  const orbited = orbitRight !== 0 || orbitUp !== 0 ? orbit(camera, pivot, orbitRight, orbitUp) : camera;
  const turned = turnRight !== 0 || turnUp !== 0 ? turn(orbited, turnRight, turnUp) : orbited;
  return forward !== 0 || right !== 0 || up !== 0 ? move(turned, forward, right, up) : turned;
}

/** A walking speed that crosses the scene's first view in about four seconds: 1, 2 or 5 times a power of ten. */
export function suggestedSpeed(distance: number): number {
  if (!(distance > 0) || !Number.isFinite(distance)) return 1;
  const exact = distance / 4;
  const power = 10 ** Math.floor(Math.log10(exact));
  const digit = [1, 2, 5].findLast((candidate) => candidate * power <= exact * 1.0001) ?? 1;
  return Number((digit * power).toPrecision(1));
}
