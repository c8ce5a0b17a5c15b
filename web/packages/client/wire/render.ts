// Generated from services/common/tigas_common/wire/render.py by `npm run wire`. Do not edit.

/** One view to render. The pose is either Euler angles and `translation`, or `position` and `quaternion`. */
export interface RenderRequest {
  scene: string;
  seq?: number;
  azimuth?: number | null;
  elevation?: number | null;
  roll?: number | null;
  translation?: [number, number, number] | null;
  position?: [number, number, number] | null;
  quaternion?: [number, number, number, number] | null;
  fx: number;
  fy: number;
  cx: number;
  cy: number;
  width: number;
  height: number;
  profile?: number | null;
  display_scale?: number;
  overscan?: number;
  depth?: boolean;
  detail?: "auto" | "full";
  coarse?: boolean;
  format?: "jpeg" | "png" | "yuv420p" | "h264" | "webp";
  video?: VideoRequest | null;
  deadline_ms?: number | null;
}
/** How to encode a view as the next frame of its session's video. */
export interface VideoRequest {
  bitrate_kbps: number;
  frames_per_s?: number;
  key?: boolean;
}
/** Changes to a scene's description; fields left out are unchanged. */
export interface SceneEdit {
  camera?: StartCamera | null;
  up?: [number, number, number] | null;
  views?: {
    [k: string]: SavedView | null;
  };
  paths?: {
    [k: string]: SavedPath | null;
  };
}
/** The camera with which a visitor enters the scene. */
export interface StartCamera {
  position: [number, number, number];
  look_at: [number, number, number];
}
/** A camera pose in the scene's own coordinates. */
export interface SavedView {
  position: [number, number, number];
  quaternion: [number, number, number, number];
}
/** A smooth camera path through keyframes. */
export interface SavedPath {
  keyframes: Keyframe[];
  easing?: "linear" | "ease-in" | "ease-out" | "ease-in-out";
  loop?: boolean;
}
/** A pose on a camera path, with its time. */
export interface Keyframe {
  position: [number, number, number];
  quaternion: [number, number, number, number];
  t_ms: number;
}
/** Precedes the body on WebTransport. From status 400 on, the body is a Problem and the other fields are null. */
export interface FrameHeader {
  status: number;
  seq: number;
  content_type: string;
  width?: number | null;
  height?: number | null;
  margin_x?: number | null;
  margin_y?: number | null;
  profile?: number | null;
  coarse?: boolean | null;
  video?: VideoInfo | null;
  timing?: ServerTiming | null;
  requests_per_s?: number | null;
}
/** A frame's place in its session's video. */
export interface VideoInfo {
  key: boolean;
  after: number | null;
  codec: string;
}
/** How the server spent its time, in milliseconds. */
export interface ServerTiming {
  queue: number;
  render: number;
  encode: number;
}
/** Why a request failed (RFC 9457, application/problem+json). */
export interface Problem {
  type: string;
  title: string;
  status: number;
  detail: string;
}
/** Facts about a scene. `camera` and `up` are known from its scene.json, or once it has been loaded. */
export interface SceneInfo {
  id: string;
  name: string;
  state: "unloaded" | "loading" | "loaded" | "broken";
  error: string | null;
  progress?: number | null;
  gaussians: number | null;
  sh_degree: number | null;
  file_bytes: number;
  file_sha256?: string | null;
  format?: string | null;
  antialiased?: boolean;
  memory_bytes: number;
  preview: string;
  up: [number, number, number];
  camera: StartCamera | null;
  background: [number, number, number];
  enhance?: ("scene" | "general") | null;
  ladder?: Rung[] | null;
  views?: {
    [k: string]: SavedView;
  };
  paths?: {
    [k: string]: SavedPath;
  };
  builtin?: boolean;
  downloads?: SceneDownload[];
}
/** One level of the quality ladder; its number is its index in the ladder, and 0 is the best. */
export interface Rung {
  name: string;
  width: number;
  height: number;
  quality: number;
  expected_kb: number;
  psnr_db?: number | null;
}
/**
 * A downloadable form of the scene's Gaussians, for clients that render them.
 *
 * `compressed` is a single file, at `/scenes/{id}/download/compressed`, made on the first request; every prefix of it
 * gives the best picture for its size. `streamed` is the levels of detail of a streamed SOG scene, file by file,
 * starting with `/scenes/{id}/download/streamed/lod-meta.json`.
 */
export interface SceneDownload {
  form?: "compressed" | "streamed";
  bytes?: number | null;
  sha256?: string | null;
  gaussians?: number | null;
}
/** The server's configuration for the page (`/config.json`). */
export interface ServerConfig {
  version: string;
  commit?: string | null;
  device?: string | null;
  ladder: Rung[];
  certificate_sha256: string | null;
  public_key_sha256?: string | null;
  webtransport_url: string | null;
  https_url: string | null;
  services: {
    [k: string]: string;
  };
  dash_h3_url?: string | null;
  retry_after_s?: number | null;
  host?: string | null;
  render_url?: string | null;
  max_upload_bytes?: number | null;
  has_scene?: boolean | null;
  formats?: ("jpeg" | "webp")[];
  congestion_control?: ("westwood" | "reno") | null;
  tcp_congestion_control?: string | null;
  why_no_training?: string | null;
}
/** Progress of the training of a scene's networks. */
export interface Training {
  state: "idle" | "running" | "done" | "failed";
  progress?: number;
  stage?: string;
  problem?: string | null;
}
/** Result of an upload. */
export interface AddedScene {
  id: string;
}
