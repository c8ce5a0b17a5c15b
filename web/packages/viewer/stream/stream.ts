/** A stream on a video element, independent of its delivery and player. */

import type { PoseUpdate, SessionStatus } from "#client/wire/dash";
import type { PlayedStream, PlayedWebRtc } from "#client/wire/store";
import type { Camera } from "./camera-feed";

/** The delivery of a stream, and its label. */
export type StreamKind = "dash" | "webrtc";
export const STREAM_NAMES: Readonly<Record<StreamKind, string>> = { dash: "DASH", webrtc: "WebRTC" };

export interface StreamEvents {
  /** Called when bytes of segments are received. */
  received(bytes: number): void;
  /** Called when the stream can no longer be played. */
  failed(reason: string): void;
}

export interface Stream {
  /** The player's name and version. */
  readonly player: string;
  /** Latency behind the live edge in seconds, as measured by the player. */
  latency(): number | null;
  /** Sets a latency other than the manifest's, in milliseconds. */
  aim(target: number): void;
  dispose(): void;
}

/** Plays a manifest from its live edge. Raises StreamUnsupported. */
export type PlayStream = (video: HTMLVideoElement, manifest: string, events: StreamEvents) => Stream;

/** Events of a stream of views. */
export interface ViewEvents extends StreamEvents {
  /** Called when frame number `frame` is known to show the pose of message `pose`. */
  told(frame: number, pose: number): void;
}

/** A played stream, by kind. */
export type Played = { readonly dash: Omit<PlayedStream, "targets_ms"> } | { readonly webrtc: PlayedWebRtc };

/** A stream of views on a video element, with a remote camera. */
export interface ViewStream extends Stream {
  /** Target latency in milliseconds; null for the lowest possible. */
  readonly targetLatency: number | null;
  /** The stream, for records. */
  readonly played: Played;
  /** The packager's report on it; null if unavailable. */
  status(signal: AbortSignal): Promise<SessionStatus | null>;
  /** The browser's receiver statistics; null if the browser is not the receiver. */
  receiver(): { readonly codec: string; readonly jitterBuffer: number | null } | null;
  /** Sends a pose; returns false if an earlier one is still waiting, and the newest must be tried again. */
  send(pose: PoseUpdate): boolean;
  /**
   * Number of the frame at a media time in seconds, as reported by the browser for the last presented one; null if
   * unknown.
   */
  frame(mediaTime: number, presented: VideoFrameCallbackMetadata): number | null;
  /** The ladder's rung for a frame's size. */
  rung(width: number, height: number): number | null;
}

/** Opens a stream that begins with a view. Rejects with StreamUnsupported, StreamEnded and ApiError. */
export type OpenViews = (
  video: HTMLVideoElement,
  view: Camera,
  events: ViewEvents,
  signal: AbortSignal,
) => Promise<ViewStream>;

/** This browser cannot play such a stream at all. */
export class StreamUnsupported extends Error {}

/** The stream ended before it started. */
export class StreamEnded extends Error {}
