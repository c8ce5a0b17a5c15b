// Generated from services/common/tigas_common/wire/shaper.py by `npm run wire`. Do not edit.

/** Play a trace from its start. */
export interface StartRequest {
  trace: string;
  loop?: boolean;
  delay_ms?: number | null;
}
/** Go to a position in the trace. */
export interface SeekRequest {
  position_ms: number;
}
/** Whether to start over at the end. */
export interface LoopRequest {
  loop: boolean;
}
/** Effects of a link on packets. */
export interface LinkSetting {
  down_kbps: number;
  up_kbps: number;
  delay_ms?: number;
  jitter_ms?: number;
  loss_pct?: number;
}
/** All available traces. */
export interface TraceList {
  traces: TraceSummary[];
}
/** A trace in the list. If `error` is not null, the trace cannot be played and the other fields are zero. */
export interface TraceSummary {
  name: string;
  uploaded: boolean;
  duration_ms?: number;
  steps?: number;
  mean_down_kbps?: number;
  min_down_kbps?: number;
  max_down_kbps?: number;
  mean_up_kbps?: number;
  outages?: number;
  error?: string | null;
}
/** A trace's outline, as means over intervals. */
export interface TracePoints {
  name: string;
  duration_ms: number;
  times_ms: number[];
  down_kbps: number[];
  up_kbps: number[];
}
/** The link and its playback at one moment. */
export interface ShaperStatus {
  time_ms: number;
  mode: "constant" | "playing" | "paused" | "ended";
  trace: string | null;
  position_ms: number | null;
  duration_ms: number | null;
  loop: boolean;
  link: LinkSetting;
  down: DirectionStatus;
  up: DirectionStatus;
  backend: "netem" | "relay";
  closed: string | null;
}
/** One direction, in tc's counting: bytes of whole Ethernet frames. */
export interface DirectionStatus {
  target_kbps: number;
  delivered_kbps: number;
  queue_bytes: number;
  queue_ms: number;
  drops: number;
}
