/** What a stream on a video element is, apart from who plays it. */

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

/** This browser can play no stream at all. */
export class StreamUnsupported extends Error {
  constructor() {
    super("This browser cannot play DASH streams: it has no Media Source Extensions.");
  }
}

/** The stream ended before it began. */
export class StreamEnded extends Error {}
