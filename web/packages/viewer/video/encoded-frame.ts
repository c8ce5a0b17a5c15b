/** A frame for the decoder worker. */
export interface EncodedFrame {
  /** Grows by one with each frame that is handed over. */
  readonly number: number;
  readonly key: boolean;
  /** As WebCodecs names it. */
  readonly codec: string;
  readonly image: Blob;
}

/** The name of the error of a frame that the decoder took and gave no picture for: no reason to begin anew. */
export const SKIPPED = "SkippedFrame";
