// Generated from services/common/tigas_common/wire/dash.py by `npm run wire`. Do not edit.

/** A DASH stream for one viewer. */
export interface SessionRequest {
  scene: string;
  position: [number, number, number];
  quaternion: [number, number, number, number];
  fx: number;
  fy: number;
  cx: number;
  cy: number;
  width: number;
  height: number;
  frame_rate?: number;
  representations?: RepresentationRequest[] | null;
  segment_s?: number;
  frames_per_chunk?: number;
  target_latency_ms?: number;
}
/** One representation that a session wants. */
export interface RepresentationRequest {
  rung: number;
  bitrate_kbps?: number | null;
}
/** The viewer's newest pose. The intrinsics may change with it; they are for the session's viewport. */
export interface PoseUpdate {
  seq: number;
  position: [number, number, number];
  quaternion: [number, number, number, number];
  fx?: number | null;
  fy?: number | null;
  cx?: number | null;
  cy?: number | null;
}
/** An offer to receive one video, on one transport with the data channels `poses` and `frames`. */
export interface WebRtcRequest {
  scene: string;
  position: [number, number, number];
  quaternion: [number, number, number, number];
  fx: number;
  fy: number;
  cx: number;
  cy: number;
  width: number;
  height: number;
  frame_rate?: 30 | 60;
  sdp: string;
  rung?: number | null;
  bitrate_kbps?: number | null;
}
/** A session that was opened; paths are relative to the packager's root. */
export interface SessionInfo {
  representations: RepresentationInfo[];
  frame_rate: number;
  segment_s: number;
  frames_per_chunk: number;
  target_latency_ms: number;
  id: string;
  manifest: string;
  poses: string;
}
/** One representation of a session. */
export interface RepresentationInfo {
  id: string;
  rung: number;
  width: number;
  height: number;
  bitrate_kbps: number;
  codecs: string;
}
/** Status of a session. */
export interface SessionStatus {
  id: string;
  scene: string;
  age_s: number;
  frames: number;
  repeated: number;
  dropped: number;
  poses: number;
  render_failures: number;
  render_problem: string | null;
  encoder_failures: number;
  watchers: number;
}
/** The pose that a frame of the stream shows: maps media time to poses. */
export interface FrameShown {
  frame: number;
  media_time_s: number;
  pose: number;
}
/** A session that was opened; `DELETE /sessions/{id}` ends it. */
export interface WebRtcSession {
  id: string;
  sdp: string;
  codec: string;
  rung: number;
  width: number;
  height: number;
  frame_rate: number;
}
/** The pose that a frame of the video shows. */
export interface SentFrame {
  rtp_timestamp: number;
  pose: number;
}
