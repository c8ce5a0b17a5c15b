/** Smooth camera paths through keyframes at any times: their positions and rotations have no jumps in speed. Pure. */
import type { ScenePose } from "../view/camera";
import {
  add,
  conjugate,
  fromRotationVector,
  multiply,
  type Quaternion,
  subtract,
  toRotationVector,
  type Vector3,
} from "../view/vector";
import { slerp, type TimedPose } from "./movement";

const EASINGS = {
  linear: (share: number) => share,
  "ease-in": (share: number) => share * share,
  "ease-out": (share: number) => share * (2 - share),
  "ease-in-out": (share: number) => share * share * (3 - 2 * share),
};

export type NamedEasing = keyof typeof EASINGS;
/** How a path starts and ends: by name, or as a function from the fraction of time to the fraction of the way, both 0 to 1. */
export type Easing = NamedEasing | ((share: number) => number);

export interface CameraPath {
  /** In milliseconds. */
  readonly duration: number;
  /** The pose at a time since the start; before it and after the end, the first and the last one. */
  at(time: number): ScenePose;
}

/** Below this length the camera rests between two keyframes. */
const NOTHING = 1e-9;

/**
 * A path through keyframes with growing times: Catmull-Rom splines for positions and rotations. A `closed` path returns to its
 * first keyframe and passes it at speed. Throws with fewer than two keyframes, and for an unknown easing.
 */
export function cameraPath(
  keyframes: readonly TimedPose[],
  { easing = "linear", closed = false } = {} as {
    readonly easing?: Easing;
    readonly closed?: boolean;
  },
): CameraPath {
  const times = keyframes.map(({ t_ms }) => t_ms);
  const first = times[0] ?? 0;
  const duration = (times.at(-1) ?? 0) - first;
  if (times.length < 2 || !times.every((time, i) => i === 0 || time > (times[i - 1] ?? time))) {
    throw new Error("A camera path needs two or more keyframes, each with a greater t_ms than the one before.");
  }
  const ease = typeof easing === "function" ? easing : EASINGS[easing];
  if (ease === undefined) {
    throw new Error(`Unknown easing “${easing}”: use ${Object.keys(EASINGS).join(", ")}.`);
  }
  const positions = spline(
    times,
    keyframes.map(({ position }) => position),
    POSITIONS,
    closed,
  );
  const rotations = spline(
    times,
    keyframes.map(({ quaternion }) => quaternion),
    ROTATIONS,
    closed,
  );
  return {
    duration,
    at: (time) => {
      const t = first + duration * ease(Math.min(1, Math.max(0, time / duration)));
      return { position: [...positions(t)], quaternion: [...rotations(t)] };
    },
  };
}

/** Arithmetic of a spline's values: the difference of two as a vector, and values along it. */
interface Space<Value> {
  way(from: Value, to: Value): Vector3;
  moved(from: Value, way: Vector3): Value;
  between(from: Value, to: Value, share: number): Value;
}

const POSITIONS: Space<Vector3> = {
  way: (from, to) => subtract(to, from),
  moved: add,
  between: (from, to, share) => add(from, scaled(subtract(to, from), share)),
};

/** Differences are rotation vectors in the camera's own frame. */
const ROTATIONS: Space<Quaternion> = {
  way: (from, to) => toRotationVector(multiply(conjugate(from), to)),
  moved: (from, way) => multiply(from, fromRotationVector(way)),
  between: (from, to, share) => slerp([...from], [...to], share),
};

/** Bézier curves between the values, by de Casteljau's construction, which also holds for rotations (Shoemake 1985). */
function spline<Value>(
  times: readonly number[],
  values: readonly Value[],
  { way, moved, between }: Space<Value>,
  closed: boolean,
): (time: number) => Value {
  const ways = values.slice(1).map((value, i) => way(values[i] as Value, value));
  const speeds = speedsAt(times, ways, closed);
  return (time) => {
    const i = Math.max(
      0,
      Math.min(
        times.length - 2,
        times.findLastIndex((start) => start <= time),
      ),
    );
    const [start, end] = [times[i] as number, times[i + 1] as number];
    const [from, to] = [values[i] as Value, values[i + 1] as Value];
    const third = (end - start) / 3;
    let points = [
      from,
      moved(from, scaled(speeds[i] as Vector3, third)),
      moved(to, scaled(speeds[i + 1] as Vector3, -third)),
      to,
    ];
    const share = (time - start) / (end - start);
    while (points.length > 1) points = points.slice(1).map((point, j) => between(points[j] as Value, point, share));
    return points[0] as Value;
  };
}

/** The velocity at each keyframe: the mean over the segments before and after it; zero where the camera rests on one side. */
function speedsAt(times: readonly number[], ways: readonly Vector3[], closed: boolean): Vector3[] {
  const spans = ways.map((_, i) => (times[i + 1] as number) - (times[i] as number));
  const speed = (before: number, after: number): Vector3 => {
    const [a, b] = [ways[before] as Vector3, ways[after] as Vector3];
    if (Math.hypot(...a) < NOTHING || Math.hypot(...b) < NOTHING) return [0, 0, 0];
    return scaled(add(a, b), 1 / ((spans[before] as number) + (spans[after] as number)));
  };
  const last = ways.length - 1;
  const inner = ways.slice(1).map((_, i) => speed(i, i + 1));
  return closed ? [speed(last, 0), ...inner, speed(last, 0)] : [speed(0, 0), ...inner, speed(last, last)];
}

function scaled([x, y, z]: Vector3, by: number): Vector3 {
  return [x * by, y * by, z * by];
}
