import { expect, test } from "vitest";
import { PAPER_LADDER } from "./ladder";
import { FrameSizes } from "./sizes";

test("what the ladder says, until a frame has come", () => {
  expect(new FrameSizes(PAPER_LADDER).expected(1)).toBe(55_000);
});

test("the moving average of what came; rungs that were not seen are scaled as the nearest that was", () => {
  const subject = new FrameSizes(PAPER_LADDER);
  subject.observe(3, 14_000);
  subject.observe(3, 7000);
  expect(subject.expected(3)).toBeCloseTo(14_000 - 0.3 * 7000);
  expect(subject.expected(2)).toBeCloseTo(20_000 * (11.9 / 7));
  subject.observe(1, 55_000);
  expect(subject.expected(0)).toBe(240_000);
});

test("what says nothing changes nothing", () => {
  const subject = new FrameSizes(PAPER_LADDER);
  subject.observe(null, 99_000);
  subject.observe(7, 99_000);
  subject.observe(0, 0);
  expect([0, 1, 2, 3].map((rung) => subject.expected(rung))).toEqual([240_000, 55_000, 20_000, 7000]);
});
