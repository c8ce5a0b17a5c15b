/**
 * Error of the seen picture against the ideal one, as measured in rendered pictures (docs/results/2026-11-seen-error.md).
 * It has two causes, rung and age, and the greater one masks the lesser: blur is hardly visible in a picture that
 * is out of place. Their mean squared errors, and their losses of SSIM, are therefore combined as norms of the degrees DEGREES.
 * The simulator judges controllers by it, and *Seen* decides by it.
 */
import type { Rung } from "../wire/render";
import type { Way } from "./controller";
import table from "./seen-error.json";

/** Error of a picture. */
export interface Seen {
  /** Mean squared error of 8-bit RGB. */
  readonly mse: number;
  readonly ssim: number;
}

type Points = readonly (readonly [x: number, y: number])[];

/** Measured points of both errors by angle, for each way. */
const LATE = Object.fromEntries(
  Object.entries(table.late).map(([way, late]) => {
    const of = (name: keyof Seen, none: number): Points => [
      [0, none],
      ...late.map((one) => [one.turn_deg, one[name]] as const),
    ];
    return [way, { mse: of("mse", 0), ssim: of("ssim", 1) }];
  }),
) as Record<Way, Readonly<Record<keyof Seen, Points>>>;

const PEAK = 255 ** 2;
/** The degrees that best fit frames with both errors. */
const DEGREES = { mse: 1.5, ssim: 3 };
/** Lower bound: two unrelated pictures. */
const LEAST_SSIM = 0.2;
const MOST_MSE = 6000;

/** Error of a rung's pictures: the ladder's value, or an estimate by size. */
export function seenOfRung({ psnr_db, expected_kb }: Pick<Rung, "psnr_db" | "expected_kb">): Seen {
  const { rungs } = table;
  const bySize = rungs.toSorted((a, b) => a.kb - b.kb).map(({ kb, psnr_db }) => [Math.log(kb), psnr_db] as const);
  const psnr = psnr_db ?? along(bySize, Math.log(expected_kb));
  const byQuality = rungs.map(({ psnr_db, ssim }) => [psnr_db, ssim] as const).toSorted(([a], [b]) => a - b);
  return { mse: PEAK * 10 ** (-psnr / 10), ssim: along(byQuality, psnr) };
}

/** Error of an otherwise perfect picture after a rotation by this many degrees. */
export function seenLate(way: Way, degrees: number): Seen {
  const { mse, ssim } = LATE[way];
  return { mse: along(mse, degrees), ssim: along(ssim, degrees) };
}

/** Error of a picture with both faults. */
export function together(a: Seen, b: Seen): Seen {
  const mse = norm(a.mse, b.mse, DEGREES.mse);
  const loss = norm(1 - a.ssim, 1 - b.ssim, DEGREES.ssim);
  return { mse: Math.min(MOST_MSE, mse), ssim: Math.max(LEAST_SSIM, 1 - loss) };
}

function norm(a: number, b: number, degree: number): number {
  return (a ** degree + b ** degree) ** (1 / degree);
}

export function decibels(mse: number): number {
  return 10 * Math.log10(PEAK / Math.max(mse, 1e-6));
}

/** Interpolates linearly between points in ascending order; constant beyond them. */
function along(points: Points, x: number): number {
  const i = points.findIndex((point) => point[0] >= x);
  const right = points[i] ?? points.at(-1);
  const left = points[i - 1];
  if (right === undefined) return Number.NaN;
  if (i < 0 || left === undefined) return right[1];
  return left[1] + ((right[1] - left[1]) * (x - left[0])) / (right[0] - left[0]);
}
