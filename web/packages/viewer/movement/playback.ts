/** Plays a movement by its own time stamps: between two points the position goes straight and the rotation along the arc. */
import type { ScenePose } from "../view/camera";

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

/** The shorter way (Shoemake 1985); nearly equal rotations are interpolated straight. */
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
