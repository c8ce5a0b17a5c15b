import { expect, test } from "vitest";
import { observation } from "#fakes/observation";
import type { Observation } from "./controller";
import { firstOffered, offering, PAPER_LADDER } from "./ladder";

test.each([
  [1920 * 1080, 0],
  [1280 * 720, 0],
  [1280 * 720 - 1, 0],
  [960 * 540, 1],
  [640 * 360 + 1, 1],
  [640 * 360, 2],
  [320 * 180, 3],
  [1, 3],
])("a picture of %i pixels is offered rung %i and those below", (pixels, first) => {
  expect(firstOffered(PAPER_LADDER, pixels)).toBe(first);
});

test("all qualities of the smallest size that covers it are offered", () => {
  const [high, medium, ...rest] = PAPER_LADDER as [(typeof PAPER_LADDER)[0], (typeof PAPER_LADDER)[0]];
  const ladder = [high, medium, { ...medium, quality: 40 }, ...rest];
  expect(firstOffered(ladder, 960 * 540)).toBe(1);
});

test("without a ladder nothing is left out", () => {
  expect(firstOffered([], 1000)).toBe(0);
});

test("a controller sees its part of the ladder as the whole", () => {
  const heard: Observation[] = [];
  const subject = offering(
    ({ ladder }) => {
      expect(ladder).toEqual(PAPER_LADDER.slice(2));
      return { decide: () => 1, observe: (told) => heard.push(told) };
    },
    { ladder: PAPER_LADDER, random: () => 0 },
    2,
  );
  expect(subject.decide(0)).toBe(3);
  for (const profile of [3, 2, 0]) subject.observe(observation({ profile }));
  expect(heard.map(({ profile }) => profile)).toEqual([1, 0, null]);
});
