/** The paper's ladder, which is the server's default. */
import type { Rung } from "../wire/render";
import type { Controller, ControllerFactory } from "./controller";

/*
 * The rungs that a controller may choose from. Pixels beyond the display's are wasted, so no rung is offered that is
 * larger than the smallest one that covers the picture.
 */

/** The first rung of the ladder offered for a picture of this many device pixels; earlier ones are too large. */
export function firstOffered(ladder: readonly Rung[], pixels: number): number {
  const sizes = ladder.map(({ width, height }) => width * height);
  const covering = Math.min(...sizes.filter((size) => size >= pixels));
  return Math.max(
    0,
    sizes.findIndex((size) => size <= covering),
  );
}

/** A controller restricted to the rungs from `first` on; its interface uses the indices of the whole ladder. */
export function offering(
  create: ControllerFactory,
  { ladder, random }: Parameters<ControllerFactory>[0],
  first: number,
): Controller {
  const controller = create({ ladder: ladder.slice(first), random });
  return {
    decide: (now) => first + controller.decide(now),
    observe: (observation) => {
      const { profile } = observation;
      controller.observe({ ...observation, profile: profile === null || profile < first ? null : profile - first });
    },
  };
}

export const PAPER_LADDER: readonly Rung[] = [
  { name: "High", width: 1280, height: 720, quality: 90, expected_kb: 240 },
  { name: "Medium-High", width: 960, height: 540, quality: 65, expected_kb: 55 },
  { name: "Medium-Low", width: 640, height: 360, quality: 35, expected_kb: 20 },
  { name: "Low", width: 320, height: 180, quality: 10, expected_kb: 7 },
];

/** QUIC's initial window (RFC 9002, section 7.2) in kB, less a fifth for margins, depth and headers. */
const FIRST_WINDOW = 0.8 * 14.72;

/** The best rung with frames that fit into a single round trip on any link. */
export function firstRung(ladder: readonly Rung[]): number {
  const first = ladder.findIndex(({ expected_kb }) => expected_kb <= FIRST_WINDOW);
  return first < 0 ? ladder.length - 1 : first;
}
