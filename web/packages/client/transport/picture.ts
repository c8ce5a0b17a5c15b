/** A decoded picture, and the coarse depth that it may carry. */

export interface DepthMap {
  readonly width: number;
  readonly height: number;
  /** The inverse depth of code 255, in 1/scene units. */
  readonly nearest: number;
  /**
   * Row by row, over the whole frame with its margins; the centre of column i is at (i + 0.5) / width. The inverse
   * depth (1/z, not along the ray) is nearest · code / 255; 0 is infinitely far.
   */
  readonly codes: Uint8Array<ArrayBuffer>;
}

export interface DecodedImage {
  readonly bitmap: ImageBitmap;
  /** Depth of the whole frame; null if it has none. */
  readonly depth: DepthMap | null;
}
