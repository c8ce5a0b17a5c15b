/** Estimates how much of a view the newest frame does not show, without reading pixels. */
import { transfer, type View } from "./view";

/** Tolerance of a share: a frame covers its own view. */
const ROUNDING = 1e-9;

/** A pixel of the view, and its homogeneous position in the frame, which is linear in the pixel. */
type Corner = readonly [u: number, v: number, x: number, y: number, z: number];

/** The share, 0 to 1, as if everything were at one inverse depth (1/z, in 1/scene units; 0: infinitely far). */
export function uncoveredShare(frame: View, view: View, inverseDepth: number): number {
  const { turn, shift } = transfer(view, frame);
  const [x0, y0, z0] = [turn[2], turn[5], turn[8]].map((value, i) => value + inverseDepth * (shift[i] ?? 0));
  const corner = (u: number, v: number): Corner => [
    u,
    v,
    turn[0] * u + turn[1] * v + (x0 ?? 0),
    turn[3] * u + turn[4] * v + (y0 ?? 0),
    turn[6] * u + turn[7] * v + (z0 ?? 0),
  ];
  const { width, height } = view;
  let seen = [corner(0, 0), corner(width, 0), corner(width, height), corner(0, height)];
  // Inside the frame, 0 ≤ x/z ≤ width and 0 ≤ y/z ≤ height, in front of its camera.
  seen = clipped(seen, ([, , , , z]) => z);
  seen = clipped(seen, ([, , x]) => x);
  seen = clipped(seen, ([, , x, , z]) => frame.width * z - x);
  seen = clipped(seen, ([, , , y]) => y);
  seen = clipped(seen, ([, , , y, z]) => frame.height * z - y);
  const share = 1 - area(seen) / (width * height);
  return share < ROUNDING ? 0 : share;
}

/** The part of a convex polygon on the side where a linear function is not negative (Sutherland and Hodgman, 1974). */
function clipped(polygon: readonly Corner[], side: (corner: Corner) => number): Corner[] {
  const kept: Corner[] = [];
  for (const [i, corner] of polygon.entries()) {
    const before = polygon.at(i - 1) ?? corner;
    const [from, to] = [side(before), side(corner)];
    if (from < 0 !== to < 0) kept.push(between(before, corner, from / (from - to)));
    if (to >= 0) kept.push(corner);
  }
  return kept;
}

function between(a: Corner, b: Corner, share: number): Corner {
  const at = (i: 0 | 1 | 2 | 3 | 4) => a[i] + share * (b[i] - a[i]);
  return [at(0), at(1), at(2), at(3), at(4)];
}

function area(polygon: readonly Corner[]): number {
  let twice = 0;
  for (const [i, [u, v]] of polygon.entries()) {
    const [pu, pv] = polygon.at(i - 1) ?? [u, v];
    twice += pu * v - u * pv;
  }
  return Math.abs(twice) / 2;
}
