/** The lens: a pinhole camera's intrinsics for the stage, in its CSS pixels. */

export interface Intrinsics {
  readonly fx: number;
  readonly fy: number;
  readonly cx: number;
  readonly cy: number;
}

export interface Viewport {
  readonly width: number;
  readonly height: number;
}

/** The server refuses longer sides and more pixels. */
const MAX_SIDE = 8192;
const MAX_PIXELS = 16_777_216;

/** Half of the vertical field of view (60°), and the least half of the horizontal one (50°), for upright phones. */
const HALF_VERTICAL = Math.PI / 6;
const HALF_HORIZONTAL = (25 * Math.PI) / 180;

/** The viewport for a stage of this many CSS pixels: whole pixels in the stage's own shape, within the server's limits. */
export function viewportFor(width: number, height: number): Viewport {
  const scale = Math.min(1, MAX_SIDE / width, MAX_SIDE / height, Math.sqrt(MAX_PIXELS / (width * height)));
  return { width: Math.max(1, Math.floor(width * scale)), height: Math.max(1, Math.floor(height * scale)) };
}

/** Square pixels, the centre in the middle, 60° from top to bottom; more on a stage that is narrower than 50° then. */
export function defaultIntrinsics({ width, height }: Viewport): Intrinsics {
  const f = Math.min(height / 2 / Math.tan(HALF_VERTICAL), width / 2 / Math.tan(HALF_HORIZONTAL));
  const focal = Math.round(f * 100) / 100;
  return { fx: focal, fy: focal, cx: width / 2, cy: height / 2 };
}
