import { expect, test } from "vitest";
import { fakeView, turned } from "#fakes/views";
import { SIDES, sideView } from "#viewer/reproject/side-pictures";
import type { View } from "#viewer/reproject/view";
import { Seen } from "./seen";

/** 77° across and 48° high. */
const VIEW = fakeView();
const NONE = new Map().values();

function afresh(frame: View): Seen {
  const seen = new Seen(10);
  seen.take(frame);
  return seen;
}

test("a frame's own view misses nothing, and one that looks the other way all of it", () => {
  const seen = new Seen(10);
  expect(seen.never(VIEW, [])).toBe(1);
  seen.take(VIEW);
  expect(seen.never(VIEW, NONE)).toBe(0);
  expect(seen.never({ ...VIEW, ...turned(180) }, NONE)).toBe(1);
});

test("earlier frames are remembered until the camera is a quarter of the distance away", () => {
  const seen = new Seen(10);
  seen.take(VIEW);
  seen.take({ ...VIEW, ...turned(60) });
  expect(seen.never({ ...VIEW, ...turned(30) }, NONE)).toBeLessThan(0.12);
  expect(afresh({ ...VIEW, ...turned(60) }).never({ ...VIEW, ...turned(30) }, NONE)).toBeGreaterThan(0.3);
  const away = { ...VIEW, ...turned(60), position: [2.6, 0, 0] } as const;
  seen.take(away);
  const back = { ...away, ...turned(0) };
  expect(afresh(away).never(back, NONE) - seen.never(back, NONE)).toBeLessThan(0.05); // the grid is coarse
});

test("with all sides nothing was never rendered, wherever one looks from within the sphere", () => {
  const seen = new Seen(10);
  const sides = SIDES.map((side) => sideView(side, [0, 0, 0], [0, -1, 0]));
  seen.take({ ...VIEW, position: [0, 0, 3], ...turned(180) });
  for (const degrees of [0, 45, 100, -90]) {
    expect(seen.never({ ...VIEW, position: [0, 0, 3], ...turned(degrees) }, sides)).toBe(0);
  }
  expect(seen.never({ ...VIEW, position: [0, 0, 9.5] }, sides)).toBeGreaterThan(0.5);
});
