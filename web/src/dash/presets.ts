/** How the DASH stream is set up. */
import type { SessionRequest } from "../wire/dash";

/** What decides a stream's latency. */
export type DashSetup = Required<
  Pick<SessionRequest, "segment_s" | "frames_per_chunk" | "target_latency_ms" | "frame_rate">
>;

/**
 * As live services ship low latency: 2 s segments, in chunks of half a second. Their targets are one to several seconds
 * (DASH-IF's guidelines aim at 3.5 s); this is the lower end, so that the comparison errs on DASH's side.
 */
export const TYPICAL: DashSetup = { segment_s: 2, frames_per_chunk: 15, target_latency_ms: 1000, frame_rate: 30 };

/**
 * The least that holds: a keyframe each second, one frame per chunk, and a target of 120 ms. On loopback lower targets hold, too,
 * but gain almost nothing, since the browser itself keeps back a few frames; a link, whose delay and queue count, leaves them no room.
 */
export const TUNED: DashSetup = { segment_s: 1, frames_per_chunk: 1, target_latency_ms: 120, frame_rate: 30 };

export const PRESETS = ["typical", "tuned", "custom"] as const;
export type Preset = (typeof PRESETS)[number];

export function setupFor(preset: Preset, custom: DashSetup): DashSetup {
  return { typical: TYPICAL, tuned: TUNED, custom }[preset];
}
