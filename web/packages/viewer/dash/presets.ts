/** Presets of the DASH stream and its player. */
import type { RepresentationRequest, SessionRequest } from "#client/wire/dash";
import type { DASH_TRANSPORTS } from "#client/wire/run";

/** Parameters that determine a stream's latency. */
export type DashSetup = Required<
  Pick<SessionRequest, "segment_s" | "frames_per_chunk" | "target_latency_ms" | "frame_rate">
>;

export interface DashPlan {
  readonly setup: DashSetup;
  /** dash.js, or the bare player on Media Source Extensions (`mse-stream.ts`). */
  readonly player: "dash.js" | "mse";
  /** The stream's only representation; null lets the packager offer several, from which the player chooses. */
  readonly representation: RepresentationRequest | null;
  /** Whether stalls raise the target (`latency-target.ts`); otherwise it is constant. */
  readonly adaptive: boolean;
  readonly transport: DashTransport;
}

export type DashTransport = keyof typeof DASH_TRANSPORTS;

export const PRESETS = ["typical", "tuned", "edge", "custom"] as const;
export type Preset = (typeof PRESETS)[number];

export const FRAME_RATES = [30, 60] as const;
export type FrameRate = (typeof FRAME_RATES)[number];
const DEFAULT_FRAME_RATE: FrameRate = 30;

/** The settings that determine a stream. */
export interface DashSettings {
  readonly dashPreset: Preset;
  /** Frames per second; null for the preset's own. */
  readonly dashFrameRate: FrameRate | null;
  /** A single representation, with the packager's bit rate by default; null for all. */
  readonly dashRepresentation: RepresentationRequest | null;
  readonly dashTransport: DashTransport;
  /** Parameters of the preset "custom". */
  readonly dashCustom: DashSetup;
}

export function planFor(settings: DashSettings): DashPlan {
  const { dashRepresentation: representation, dashTransport: transport } = settings;
  return { ...chosen(settings), representation, transport };
}

function chosen({
  dashPreset,
  dashFrameRate,
  dashCustom,
}: DashSettings): Omit<DashPlan, "representation" | "transport"> {
  const frame_rate = dashFrameRate ?? DEFAULT_FRAME_RATE;
  switch (dashPreset) {
    case "typical":
      return { setup: typical(frame_rate), player: "dash.js", adaptive: false };
    case "tuned":
      return { setup: tuned(frame_rate), player: "dash.js", adaptive: true };
    case "edge":
      return { setup: edge(frame_rate), player: "mse", adaptive: true };
    case "custom":
      return { setup: dashCustom, player: "dash.js", adaptive: false };
  }
}

/**
 * As low-latency live services are set up: 2 s segments in chunks of half a second. Their targets are one to several seconds
 * (DASH-IF's guidelines aim at 3.5 s); this is the lower end, so that the comparison favours DASH.
 */
function typical(frame_rate: number): DashSetup {
  return { segment_s: 2, frames_per_chunk: frame_rate / 2, target_latency_ms: 1000, frame_rate };
}

/** The lowest latency that dash.js holds: a keyframe each second, one frame per chunk, and a target of 120 ms. */
export function tuned(frame_rate: number): DashSetup {
  return { segment_s: 1, frames_per_chunk: 1, target_latency_ms: 120, frame_rate };
}

/** The same stream for our own player, which holds half that target. */
function edge(frame_rate: number): DashSetup {
  return { ...tuned(frame_rate), target_latency_ms: 60 };
}
