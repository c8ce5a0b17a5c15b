/**
 * How far what is seen is from what should be seen, as a mean squared error of 8-bit pictures: that of the picture itself, which
 * its rung decides, and that of its age, which grows with how far the camera has turned since the pose that it was rendered for.
 * The two come from different causes, so they are added.
 */
import type { Rung } from "../wire/render";

/** How the page shows a frame that is older than the view. */
export const WAYS = ["stale", "rotation", "depth", "predicted"] as const;
export type Way = (typeof WAYS)[number];

const PEAK = 255 ** 2;
/**
 * Recorded heads in the courtyard, 15 % overscan: 17.7, 15.6 and 13.3 dB at ages of 50, 100 and 300 ms as frames come; rotated 32.2,
 * 27.3 and 20.1; with depth 38.5, 34.1 and 25.4; predicted, with depth, 39.5 and 27.9 at the last two. In 100 ms they turned by
 * 4.4°. Power laws through the first and the last.
 */
const TURN = 4.4;
const ERRORS: Readonly<Record<Way, { readonly error: number; readonly power: number }>> = {
  stale: { error: 1640, power: 0.57 },
  rotation: { error: 115, power: 1.55 },
  depth: { error: 29, power: 1.68 },
  predicted: { error: 7.3, power: 2.43 },
};
/** Of two pictures that have nothing in common. */
const UNRELATED = 4000;
/** Where a ladder does not say how good its rungs are: as the paper's are in the courtyard. */
const BEST_DB = 41;
const BEST_KB = 240;
const DB_A_DOUBLING = 3;

/** Of a rung's pictures. */
export function rungError({ psnr_db, expected_kb }: Pick<Rung, "psnr_db" | "expected_kb">): number {
  return errorOf(psnr_db ?? BEST_DB + DB_A_DOUBLING * Math.log2(expected_kb / BEST_KB));
}

/** Of a picture whose camera has turned by so many degrees since. */
export function ageError(way: Way, degrees: number): number {
  const { error, power } = ERRORS[way];
  return Math.min(UNRELATED, error * (degrees / TURN) ** power);
}

/** The PSNR of a mean squared error, and back. */
export function decibels(error: number): number {
  return 10 * Math.log10(PEAK / error);
}

function errorOf(db: number): number {
  return PEAK * 10 ** (-db / 10);
}
