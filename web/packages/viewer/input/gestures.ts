/** Interprets mouse, fingers and wheel: turns positions in CSS pixels into nudges of the camera. Pure. */
import { NO_NUDGE, type Nudge } from "../view/motion";

interface Point {
  readonly x: number;
  readonly y: number;
}

/** How far a wheel's notch goes, in seconds of walking; browsers report about 100 pixels or 3 lines for one. */
const NOTCH_SECONDS = 0.2;
const NOTCH = { 0: 100, 1: 3, 2: 1 } as const;
/** Browsers report a trackpad's pinch as a wheel event with Ctrl, in pixels smaller than a scroll's by this factor. */
const TRACKPAD_PINCH = 0.1;
/** A pinch to twice the size goes forward by this, in seconds of walking. */
const PINCH_SECONDS = 1.2;
/** Degrees of orbit across the width of the stage. */
const ORBIT_DEGREES = 180;
/** Two fingers moved across the stage's height go this far, in seconds of walking. */
const PAN_SECONDS = 2;
/** Limit of one event, however fast the wheel spins. */
const MAX_NOTCHES = 5;

/** Look: the point under the pointer stays under it. `fx`, `fy` are in CSS pixels. */
export function look(from: Point, to: Point, focal: { readonly fx: number; readonly fy: number }): Nudge {
  const degrees = 180 / Math.PI;
  return {
    ...NO_NUDGE,
    turnRight: Math.atan((from.x - to.x) / focal.fx) * degrees,
    turnUp: Math.atan((to.y - from.y) / focal.fy) * degrees,
  };
}

/** Orbit: the near side of the focus follows the pointer, half a turn across the stage. */
export function orbit(from: Point, to: Point, stageWidth: number): Nudge {
  const perPixel = ORBIT_DEGREES / Math.max(1, stageWidth);
  return { ...NO_NUDGE, orbitRight: (to.x - from.x) * perPixel, orbitUp: (from.y - to.y) * perPixel };
}

/** The scene follows the pointer sideways, up and down. */
export function pan(from: Point, to: Point, stageHeight: number): Nudge {
  const perPixel = PAN_SECONDS / Math.max(1, stageHeight);
  return { ...NO_NUDGE, right: (from.x - to.x) * perPixel, up: (to.y - from.y) * perPixel };
}

/** One event of a wheel, in seconds of walking: turning it away goes forward, as spreading the fingers on a trackpad does. */
export function wheel({ deltaY, deltaMode, ctrlKey }: Pick<WheelEvent, "deltaY" | "deltaMode" | "ctrlKey">): number {
  const notch = NOTCH[deltaMode as keyof typeof NOTCH] ?? NOTCH[0];
  const notches = -deltaY / (ctrlKey && Math.abs(deltaY) < notch / 2 ? TRACKPAD_PINCH * notch : notch);
  return Math.max(-MAX_NOTCHES, Math.min(MAX_NOTCHES, notches)) * NOTCH_SECONDS;
}

/** Two fingers: apart goes forward, together goes back, both in one direction drags the scene along. */
export function pinch(from: readonly [Point, Point], to: readonly [Point, Point], stageHeight: number): Nudge {
  const spread = ([a, b]: readonly [Point, Point]) => Math.max(1, Math.hypot(a.x - b.x, a.y - b.y));
  const middle = ([a, b]: readonly [Point, Point]) => ({ x: (a.x + b.x) / 2, y: (a.y + b.y) / 2 });
  return {
    ...pan(middle(from), middle(to), stageHeight),
    forward: Math.log2(spread(to) / spread(from)) * PINCH_SECONDS,
  };
}

export function sum(a: Nudge, b: Nudge): Nudge {
  return {
    turnRight: a.turnRight + b.turnRight,
    turnUp: a.turnUp + b.turnUp,
    orbitRight: a.orbitRight + b.orbitRight,
    orbitUp: a.orbitUp + b.orbitUp,
    forward: a.forward + b.forward,
    right: a.right + b.right,
    up: a.up + b.up,
  };
}
