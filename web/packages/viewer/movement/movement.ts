/** Movement traces: camera poses with their own time stamps, in a levelled frame with OpenCV's axes. Pure. */
import { type ANCHORS, type UNITS, VIEW_M } from "#client/wire/movement";
import type { SceneInfo, StartCamera } from "#client/wire/render";
import { levelFor, orientation, type ScenePose, startCamera } from "../view/camera";
import { add, conjugate, multiply, rotate, subtract } from "../view/vector";

/** A pose at a time, in the scene's own frame. */
export interface TimedPose extends ScenePose {
  /** Since the movement's start, in milliseconds. */
  readonly t_ms: number;
}

/** The pose at a time; before the first point and after the last, that point's. `points` are in the order of time. */
export function poseAt(points: readonly TimedPose[], t: number): ScenePose {
  let low = 0;
  let high = points.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if ((points[middle] as TimedPose).t_ms <= t) low = middle + 1;
    else high = middle;
  }
  const before = points[Math.max(0, low - 1)];
  const after = points[Math.min(points.length - 1, low)];
  if (before === undefined || after === undefined) throw new Error("a movement needs a point");
  const span = after.t_ms - before.t_ms;
  const share = span > 0 ? Math.max(0, (t - before.t_ms) / span) : 0;
  return {
    position: interpolated(before.position, after.position, share) as [number, number, number],
    quaternion: slerp(before.quaternion, after.quaternion, share),
  };
}

function interpolated(a: readonly number[], b: readonly number[], share: number): number[] {
  return a.map((value, i) => value + ((b[i] ?? value) - value) * share);
}

/** Interpolates the shorter way (Shoemake 1985); nearly equal rotations are interpolated linearly. */
export function slerp(a: ScenePose["quaternion"], b: ScenePose["quaternion"], share: number): ScenePose["quaternion"] {
  const dot = a.reduce((sum, value, i) => sum + value * (b[i] ?? 0), 0);
  const sign = dot < 0 ? -1 : 1;
  const angle = Math.acos(Math.min(1, Math.abs(dot)));
  const [wa, wb] =
    angle < 1e-4
      ? [1 - share, share]
      : [Math.sin((1 - share) * angle) / Math.sin(angle), Math.sin(share * angle) / Math.sin(angle)];
  const mixed = a.map((value, i) => wa * value + wb * sign * (b[i] ?? 0));
  const length = Math.hypot(...mixed);
  return mixed.map((value) => value / length) as ScenePose["quaternion"];
}

/** `start`: begins at the origin looking along z, which is the scene's start camera. `scene`: in the scene's levelled frame. */
export type Anchor = (typeof ANCHORS)[number];
/** The unit of positions: metres, or the scene's own. */
export type Unit = (typeof UNITS)[number];

export interface MovementTrace {
  readonly anchor: Anchor;
  readonly unit: Unit;
  /** Other metadata of the file, by key. */
  readonly comments: ReadonlyMap<string, string>;
  /** Poses in a levelled frame; times increase from 0, rotations have length 1. Never empty. */
  readonly points: readonly TimedPose[];
  /** From the first pose to the last, in milliseconds. */
  readonly duration: number;
}

/** Why a text is not a movement, in one sentence. */
export class MovementError extends Error {}

/** Less than `tigas` reads, because a page may be on a phone: more than 90 minutes at 90 poses per second. */
export const MAX_POINTS = 500_000;
/**
 * The movement in a scene's own frame and unit. Anchored at the start it begins where the start camera stands, turned by its
 * azimuth (not by its elevation: a movement looks level before it looks up or down); in a scene without one, at the origin.
 */
export function placeInScene(
  { anchor, unit, points }: Pick<MovementTrace, "anchor" | "unit" | "points">,
  scene: Pick<SceneInfo, "camera" | "up">,
): TimedPose[] {
  const level = levelFor(scene.up);
  const { position: origin, azimuth } = startCamera(anchor === "start" ? scene : { ...scene, camera: null });
  const rotation = multiply(level, orientation(azimuth, 0));
  const offset = rotate(level, origin);
  const scale = unit === "m" ? metre(scene.camera) : 1;
  return points.map(({ t_ms, position: [x, y, z], quaternion }) => ({
    t_ms,
    position: [...add(offset, rotate(rotation, [scale * x, scale * y, scale * z]))],
    quaternion: [...multiply(rotation, quaternion)],
  }));
}

/** A pose of the scene's own frame in its levelled frame, the frame of traces anchored to the scene. */
export function toLevelFrame({ position, quaternion }: ScenePose, scene: Pick<SceneInfo, "up">): ScenePose {
  const toLevel = conjugate(levelFor(scene.up));
  return { position: [...rotate(toLevel, position)], quaternion: [...multiply(toLevel, quaternion)] };
}

/** How many of the scene's units a metre is. */
function metre(camera: StartCamera | null): number {
  return camera === null ? 1 : Math.hypot(...subtract(camera.position, camera.look_at)) / VIEW_M || 1;
}
