/** What a stream on a video element is, apart from what brings and plays it. */

import type { PoseUpdate, SessionStatus } from "../wire/dash";
import type { PlayedStream, PlayedWebRtc } from "../wire/store";
import type { Camera } from "./camera-feed";

/** What brings a stream, and what people call it. */
export type StreamKind = "dash" | "webrtc";
export const STREAM_NAMES: Readonly<Record<StreamKind, string>> = { dash: "DASH", webrtc: "WebRTC" };

export interface StreamEvents {
  /** Bytes of segments came in. */
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

/** What happens to a stream of views. */
export interface ViewEvents extends StreamEvents {
  /** Frame number `frame` shows the pose of message `pose`. */
  told(frame: number, pose: number): void;
}

/** What was played, by its kind. */
export type Played = { readonly dash: Omit<PlayedStream, "targets_ms"> } | { readonly webrtc: PlayedWebRtc };

/** A stream of views on a video element, whose camera is told of. */
export interface ViewStream extends Stream {
  /** What it is to have, in milliseconds; null: as little as it can. */
  readonly targetLatency: number | null;
  /** For records. */
  readonly played: Played;
  /** How the packager does with it; null where that cannot be had. */
  status(signal: AbortSignal): Promise<SessionStatus | null>;
  /** What the browser tells of receiving it; null of what it does not receive by itself. */
  receiver(): { readonly codec: string; readonly jitterBuffer: number | null } | null;
  /** Sends a pose, unless an earlier one still waits: then false, and the newest is to be tried again. */
  send(pose: PoseUpdate): boolean;
  /**
   * The number of the frame that the video has at a media time, in seconds, as the browser tells of the one that it presented last;
   * null: it does not say.
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
