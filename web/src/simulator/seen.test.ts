import { expect, test } from "vitest";
import { fakeView, turned } from "../reproject/fake-view";
import { SIDES, sideView } from "../reproject/sides";
import { Seen } from "./seen";

/** 77° across and 48° high. */
const VIEW = fakeView();
const NONE = new Map().values();

test("a frame's own view misses nothing, and one that looks the other way all of it", () => {
  const seen = new Seen(10);
  expect(seen.missing(VIEW, [])).toEqual({ uncovered: 1, never: 1 });
  seen.take(VIEW);
  expect(seen.missing(VIEW, NONE)).toEqual({ uncovered: 0, never: 0 });
  expect(seen.missing({ ...VIEW, ...turned(180) }, NONE)).toEqual({ uncovered: 1, never: 1 });
});

test("earlier frames are remembered until the camera is a quarter of the distance away", () => {
  const seen = new Seen(10);
  seen.take(VIEW);
  seen.take({ ...VIEW, ...turned(60) });
  const { uncovered, never } = seen.missing({ ...VIEW, ...turned(30) }, NONE);
  expect(uncovered).toBeGreaterThan(0.3);
  expect(never).toBeLessThan(0.12);
  seen.take({ ...VIEW, ...turned(60), position: [2.6, 0, 0] });
  const moved = seen.missing({ ...VIEW, ...turned(0), position: [2.6, 0, 0] }, NONE);
  expect(moved.uncovered - moved.never).toBeLessThan(0.05); // the grid is coarse
});

test("with all sides nothing was never rendered, wherever one looks from within the sphere", () => {
  const seen = new Seen(10);
  const sides = SIDES.map((side) => sideView(side, [0, 0, 0], [0, -1, 0]));
  seen.take({ ...VIEW, position: [0, 0, 3], ...turned(180) });
  for (const degrees of [0, 45, 100, -90]) {
    expect(seen.missing({ ...VIEW, position: [0, 0, 3], ...turned(degrees) }, sides).never).toBe(0);
  }
  expect(seen.missing({ ...VIEW, position: [0, 0, 9.5] }, sides).never).toBeGreaterThan(0.5);
});
