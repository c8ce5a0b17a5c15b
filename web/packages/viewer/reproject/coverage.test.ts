import { expect, test } from "vitest";
import { fakeView, turned } from "#fakes/views";
import { uncoveredShare } from "./coverage";
import { resized, viewOfFrame } from "./view";

const VIEW = fakeView();
const WIDE = viewOfFrame(VIEW, { width: 200, height: 110, marginX: 20, marginY: 10 });

test("a frame covers its own view, in any size", () => {
  expect(uncoveredShare(VIEW, VIEW, 0)).toBe(0);
  expect(uncoveredShare(VIEW, resized(VIEW, 1920, 1080), 1)).toBe(0);
});

test("margins cover small turns", () => {
  const view = { ...VIEW, ...turned(5) };
  expect(uncoveredShare(VIEW, view, 0)).toBeGreaterThan(0.05);
  expect(uncoveredShare(WIDE, view, 0)).toBe(0);
});

test("nothing is covered after turning away", () => {
  expect(uncoveredShare(WIDE, { ...VIEW, ...turned(180) }, 0)).toBe(1);
  expect(uncoveredShare(WIDE, { ...VIEW, ...turned(90) }, 0)).toBe(1);
});

test("half a view's width to the side of a wall, half of it is uncovered", () => {
  const view = fakeView({ position: [4 * 0.8, 0, 0] });
  expect(uncoveredShare(VIEW, view, 1 / 4)).toBeCloseTo(0.5);
  expect(uncoveredShare(VIEW, view, 0)).toBe(0);
});
