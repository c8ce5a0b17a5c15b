// Generated from services/experiments/tigas_experiments/wire/store.py by `npm run wire`. Do not edit.

import type { RepresentationInfo, RepresentationRequest } from "./dash";
import type { RenderRequest, ServerTiming } from "./render";
import type { LinkSetting } from "./shaper";

export type JsonValue = unknown;
/** An experiment file (docs/experiments.md), and inputs that only the page has. */
export interface ExperimentRequest {
  file: string;
  movements?: {
    [k: string]: string;
  };
  traces_s?: {
    [k: string]: number;
  };
}
/** A page's request for a run to perform. */
export interface NextRequest {
  page: string;
  begin?: boolean;
  allow_changes?: boolean;
}
/** A performed run. Metrics can be computed from any valid one. */
export interface RunUpload {
  problem?: string | null;
  recording?: Recording | null;
  link?: LinkSample[];
  backend?: ("netem" | "relay") | null;
  sampling_problem?: string | null;
}
/** One run, as seen by the viewer. */
export interface Recording {
  scene: string;
  mode: "stateless" | "video" | "dash" | "webrtc" | "side-by-side" | "local";
  transport: string | null;
  dash?: PlayedStream | null;
  webrtc?: PlayedWebRtc | null;
  local?: PlayedDownload | null;
  user_agent: string;
  lens: Lens;
  started_unix_ms: number;
  duration_ms: number;
  ended_ms: number;
  complete: boolean;
  hidden: boolean;
  display_interval_ms?: number | null;
  inputs: Input[];
  frames: ShownFrame[];
  replies?: Reply[];
  requests?: Request[];
  captures: Capture[];
  traffic: Traffic[];
}
/** The stream of a DASH mode, as made by the packager, and its player. */
export interface PlayedStream {
  representations: RepresentationInfo[];
  frame_rate: number;
  segment_s: number;
  frames_per_chunk: number;
  target_latency_ms: number;
  player: string;
  targets_ms?: number[];
  protocols?: string[];
}
/** Statistics of WebRTC. */
export interface PlayedWebRtc {
  codec: string;
  rung: number;
  width: number;
  height: number;
  frame_rate: number;
  lost_packets: number;
}
/** Download and rendering of the scene in the mode `local`. Times in ms; None if something never happened. */
export interface PlayedDownload {
  form: "compressed" | "streamed" | "ply";
  renderer: string | null;
  began_ms: number;
  first_picture_ms: number | null;
  complete_ms: number | null;
  downloaded_bytes: number;
  bytes: number;
  gaussians: number | null;
}
/** The viewport and its intrinsics, in pixels. */
export interface Lens {
  width: number;
  height: number;
  fx: number;
  fy: number;
  cx: number;
  cy: number;
}
/** A pose sampled by the rig because it changed, or one that the rig should have sampled. */
export interface Input {
  at: number;
  pose: number;
  missed?: boolean;
  position: [number, number, number];
  quaternion: [number, number, number, number];
}
/** A frame that was on screen. */
export interface ShownFrame {
  side: "stateless" | "dash" | "webrtc" | "local";
  at: number;
  pose: number;
  view?: number | null;
  filled?: number | null;
  warp_ms?: number | null;
  latencies: number[];
  rung: number | null;
  width: number;
  height: number;
  shown_width?: number | null;
  shown_height?: number | null;
  enhance_ms?: number | null;
}
/** A frame received in the modes `stateless` and `video`, shown or not. Superseded requests have none. */
export interface Reply {
  at: number;
  asked_at: number;
  first_byte_at: number;
  pose: number;
  asked_rung: number | null;
  rung: number | null;
  bytes: number;
  server: ServerTiming | null;
  throughput_kbps: number | null;
}
/** A request in the mode `stateless` or `video`, and its outcome. */
export interface Request {
  at: number;
  pose: number;
  asked_rung: number | null;
  fate: "shown" | "overtaken" | "cancelled" | "dropped" | "unanswered";
}
/** The screen at a tick of the run's clock, kept as a picture. */
export interface Capture {
  at: number;
  shown_at: number;
  pose: number;
  view?: number | null;
  filled?: number | null;
  rung: number | null;
  width: number;
  height: number;
}
/** Bytes received by the page so far. */
export interface Traffic {
  at: number;
  bytes: number;
}
/** The link at one moment of a run. */
export interface LinkSample {
  at: number;
  position_ms: number | null;
  target_kbps: number;
  delivered_kbps: number;
  queue_ms: number;
  drops: number;
  up_delivered_kbps: number;
}
/** All samples of a run, sent after their pictures. */
export interface SampleIndex {
  samples: Sample[];
}
/** A kept frame of the mode `stateless`: the JPEG as received and, with enhancement, as shown. */
export interface Sample {
  seq: number;
  at: number;
  request: RenderRequest;
  rung: number | null;
  bytes: number;
  restore?: string;
  upscale?: string;
  enhance_ms?: number | null;
  width: number;
  height: number;
  enhanced?: boolean;
}
/** An expanded experiment file. */
export interface PlanSummary {
  runs: number;
  lasting: string;
  problem: string | null;
}
/** Answer to an ExperimentRequest. */
export interface ExperimentCreated {
  id: string;
}
/** The next run of an experiment, or a reason to wait or stop. */
export interface NextRun {
  job: RunJob | null;
  planned: number;
  missing: number;
  remaining_s: number;
  wait: boolean;
  problem: string | null;
}
/** A run for the page to perform. */
export interface RunJob {
  run: string;
  title: string;
  configuration: Configuration;
  settings: {
    [k: string]: JsonValue;
  };
  plan: RunPlan;
}
/** Configuration of one run. Runs with equal configurations get equal inputs. */
export interface Configuration {
  scene: string;
  movement: string;
  movement_offset_s?: number;
  network: Network;
  mode:
    | "stateless"
    | "video"
    | "dash-typical"
    | "dash-tuned"
    | "dash-edge"
    | "webrtc"
    | "local-ply"
    | "local-compressed"
    | "local-streamed";
  duration_s: number;
  width: number;
  height: number;
  profile?: number | string;
  dash_frame_rate?: (30 | 60) | null;
  dash_representation?: RepresentationRequest | null;
  dash_transport?: "tcp" | "h3";
  restore?: string;
  upscale?: string;
  reprojection?: boolean;
  prediction?: string;
  overscan?: "auto" | number;
  depth?: boolean;
  surround?: boolean;
  seed?: number;
  segment?: number;
  repeat?: number;
  capture_every_ms?: number;
  sample_stride?: number;
  warm_up_s?: number;
}
/** The network of a run: a constant link, a trace (of the shaper or from a file), or unshaped. */
export interface Network {
  link?: LinkSetting | null;
  trace?: string | null;
  trace_file?: string | null;
  rtt_ms?: number | null;
  offset_s?: number;
}
/** The part of a run that the page plays and records. */
export interface RunPlan {
  points: TimedPose[];
  duration_ms: number;
  capture_every_ms: number;
  sample_stride: number;
  download: boolean;
}
/** A pose at a time, in the scene's own frame. */
export interface TimedPose {
  t_ms: number;
  position: number[];
  quaternion: number[];
}
/** All experiments, newest first. */
export interface ExperimentList {
  experiments: ExperimentSummary[];
}
/** One experiment in the list. */
export interface ExperimentSummary {
  id: string;
  name: string;
  created: string;
  source: "command" | "page";
  planned?: number | null;
  runs: number;
  complete: number;
  sampled: number;
}
/** One experiment and its runs. */
export interface Experiment {
  id: string;
  name: string;
  created: string;
  source: "command" | "page";
  plan: {
    [k: string]: JsonValue;
  };
  complete: number;
  runs: RunRow[];
}
/** One run of an experiment. */
export interface RunRow {
  folder: string;
  status: "running" | "complete" | "failed";
  problem: string | null;
  configuration: Configuration;
  samples: SampleCounts | null;
  saturated_share?: number | null;
}
/** Summary of a run's samples. */
export interface SampleCounts {
  samples: number;
  identical: number;
  different: number;
  missing: number;
}
/** The samples of a run, ordered by time. */
export interface SampleList {
  samples: SampleRow[];
  problem: string | null;
}
/** One sample of a run. Pictures are file names (`/experiments/{id}/runs/{run}/samples/{name}`), or null. */
export interface SampleRow {
  seq: number;
  at: number;
  rung: number | null;
  bytes: number;
  width: number;
  height: number;
  restore: string;
  upscale: string;
  enhance_ms: number | null;
  original: string | null;
  enhanced: string | null;
  truth: string | null;
  replayed: string | null;
  identical: boolean | null;
  problem: string | null;
}
/** Progress of rendering an experiment's samples again. */
export interface Materialisation {
  state: "idle" | "running";
  done: number;
  total: number;
  problem: string | null;
}
/** The samples of a run that the store already has: a resumed upload sends only the others. */
export interface UploadedSamples {
  complete: boolean;
  files: UploadedFile[];
}
/** A picture of a sample. */
export interface UploadedFile {
  name: string;
  bytes: number;
}
/** All movement traces, by name. */
export interface MovementList {
  movements: Movement[];
}
/** A movement trace. */
export interface Movement {
  name: string;
  duration_ms: number;
  anchor: "start" | "scene";
  description: string;
}
