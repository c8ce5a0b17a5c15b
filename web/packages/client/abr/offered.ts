/**
 * The rungs that a controller may choose from. Pixels beyond the display's are wasted, so no rung is offered that is
 * larger than the smallest one that covers the picture.
 */
import type { Rung } from "../wire/render";
import type { Controller, ControllerFactory } from "./controller";

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
