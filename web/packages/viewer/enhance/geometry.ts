/** Which part of a picture is displayed, and how it is sampled. */

export interface Size {
  readonly width: number;
  readonly height: number;
}

/** Sampling along one side, in the picture's pixels. */
export interface Sampling {
  /** Start of the displayed part. */
  readonly origin: number;
  /** Distance from one displayed pixel to the next. */
  readonly step: number;
  /** Length of the whole picture. */
  readonly length: number;
}

/** Like `object-fit: cover` in CSS: the picture fills the display and is cropped on both sides. */
export function cover(picture: Size, display: Size): { readonly across: Sampling; readonly down: Sampling } {
  const step = Math.min(picture.width / display.width, picture.height / display.height);
  const along = (length: number, displayed: number) => ({ origin: (length - displayed * step) / 2, step, length });
  return { across: along(picture.width, display.width), down: along(picture.height, display.height) };
}
