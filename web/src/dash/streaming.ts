/** What a stream on a video element is, apart from the library that plays it. */

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
  dispose(): void;
}

/** Plays a manifest from its live edge. Raises Unplayable. */
export type PlayStream = (video: HTMLVideoElement, manifest: string, events: StreamEvents) => Stream;

/** This browser can play no stream at all. */
export class StreamUnsupported extends Error {}

/** The stream ended before it began. */
export class StreamEnded extends Error {}
