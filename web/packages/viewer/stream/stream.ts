/** A stream on a video element, independent of its delivery and player. */

import type { PoseUpdate, SessionStatus } from "#client/wire/dash";
import type { PlayedStream, PlayedWebRtc } from "#client/wire/store";
import type { Camera } from "./camera-feed";

/** The delivery of a stream, and its label. */
export type StreamKind = "dash" | "webrtc";
export const STREAM_NAMES: Readonly<Record<StreamKind, string>> = { dash: "DASH", webrtc: "WebRTC" };

export interface StreamEvents {
  /** Bytes of segments were received. */
  received(bytes: number): void;
  /** The stream cannot be played any longer. */
  failed(reason: string): void;
}

export interface Stream {
  /** The player's name and version. */
  readonly player: string;
  /** Behind the live edge, in seconds, as the player counts. */
  latency(): number | null;
  /** Hold another latency than the manifest asks for, in milliseconds. */
  aim(target: number): void;
  dispose(): void;
}

/** Plays a manifest from its live edge. Raises StreamUnsupported. */
export type PlayStream = (video: HTMLVideoElement, manifest: string, events: StreamEvents) => Stream;

/** Events of a stream of views. */
export interface ViewEvents extends StreamEvents {
  /** Frame number `frame` shows the pose of message `pose`. */
  told(frame: number, pose: number): void;
}

/** A played stream, by kind. */
export type Played = { readonly dash: Omit<PlayedStream, "targets_ms"> } | { readonly webrtc: PlayedWebRtc };

/** A stream of views on a video element, with a remote camera. */
export interface ViewStream extends Stream {
  /** Target latency in milliseconds; null: as low as possible. */
  readonly targetLatency: number | null;
  /** For records. */
  readonly played: Played;
  /** The packager's report on it; null if unavailable. */
  status(signal: AbortSignal): Promise<SessionStatus | null>;
  /** The browser's receiver statistics; null if it is not the receiver. */
  receiver(): { readonly codec: string; readonly jitterBuffer: number | null } | null;
  /** Sends a pose, unless an earlier one still waits: then false, and the newest is to be tried again. */
  send(pose: PoseUpdate): boolean;
  /**
   * Number of the frame at a media time in seconds, as reported by the browser for the last presented one; null if
   * unknown.
   */
  frame(mediaTime: number, presented: VideoFrameCallbackMetadata): number | null;
  /** The ladder's rung, by a frame's size. */
  rung(width: number, height: number): number | null;
}

/** Opens a stream that begins with a view. Rejects with StreamUnsupported, StreamEnded and ApiError. */
export type OpenViews = (
  video: HTMLVideoElement,
  view: Camera,
  events: ViewEvents,
  signal: AbortSignal,
) => Promise<ViewStream>;

/** This browser can play no such stream at all. */
export class StreamUnsupported extends Error {}

/** The stream ended before it began. */
export class StreamEnded extends Error {}
