import { describe, expect, test } from "vitest";
import { orientation, type ScenePose } from "../view/camera";
import { angleBetween } from "../view/vector";
import { Guarded } from "./guarded";
import type { Predictor } from "./predictor";
import { Velocity } from "./velocity";

const pose = (azimuth: number, x = 0): ScenePose => ({ position: [x, 0, 0], quaternion: [...orientation(azimuth, 0)] });
const guarded = (predictor: Predictor = new Velocity()) => new Guarded(predictor, () => 4);

/** Turns at 60 degrees per second for half a second, and returns the time of the end. */
function turning(predictor: Predictor, rate = 60): number {
  for (let i = 0; i <= rate / 2; i++) predictor.observe(pose((i * 60) / rate), 1000 + (i * 1000) / rate);
  return 1500;
}

test.each([30, 60, 120])("at %d Hz a steady turn goes on", (rate) => {
  const predictor = guarded();
  turning(predictor, rate);
  expect(angleBetween(predictor.predict(100).quaternion, pose(36).quaternion)).toBeLessThan(1e-6);
});

test("once the camera rests, its very pose is asked for", () => {
  const predictor = guarded({ observe: () => undefined, reset: () => undefined, predict: () => pose(77) });
  const end = turning(predictor);
  expect(predictor.predict(100)).toEqual(pose(77));
  for (let at = end; at <= end + 250; at += 10) predictor.observe(pose(30), at);
  expect(predictor.predict(100)).toEqual(pose(30));
});

describe("what was before says nothing", () => {
  test.each([
    ["after a turn that nobody makes", pose(120), 1516],
    ["after a jump", pose(31, 2), 1516],
    ["on a clock that went back", pose(31), 900],
  ])("%s", (_, next, at) => {
    const predictor = guarded();
    turning(predictor);
    predictor.observe(next, at);
    expect(predictor.predict(100)).toEqual(next);
  });
});

test("a pose that is none is passed over, and none is answered", () => {
  const predictor = guarded();
  turning(predictor);
  predictor.observe({ position: [Number.NaN, 0, 0], quaternion: [0, 0, 0, 1] }, 1516);
  expect(predictor.predict(0)).toEqual(pose(30));
  const broken = guarded({
    observe: () => undefined,
    reset: () => undefined,
    predict: () => ({ position: [0, 0, 0], quaternion: [0, 0, 0, 0] }),
  });
  turning(broken);
  expect(broken.predict(100)).toEqual(pose(30));
});

test("looks at no time but the future", () => {
  const predictor = guarded();
  turning(predictor);
  expect([-1, 0, Number.NaN].map((ahead) => predictor.predict(ahead))).toEqual([pose(30), pose(30), pose(30)]);
});
