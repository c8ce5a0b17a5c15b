/** A frame for the decoder worker. */
export interface EncodedFrame {
  /** Increases by one with each frame that is handed over. */
  readonly number: number;
  readonly key: boolean;
  /** The codec's WebCodecs name. */
  readonly codec: string;
  readonly image: Blob;
}

/** Error name for a frame that the decoder took without giving a picture, which is no reason to restart. */
export const SKIPPED = "SkippedFrame";
