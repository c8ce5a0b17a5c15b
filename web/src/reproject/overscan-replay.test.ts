import { expect, test } from "vitest";
import type { TimedPose } from "../movement/playback";
import { replay } from "./overscan-replay";

/** Turns to the right, so many degrees a second, for four seconds. */
function turn(speed: number): TimedPose[] {
  return Array.from({ length: 241 }, (_, i) => {
    const half = (speed * i * Math.PI) / (60 * 360);
    return { t_ms: (i * 1000) / 60, position: [0, 0, 0], quaternion: [0, Math.sin(half), 0, Math.cos(half)] };
  });
}

const OFF = { age: 100, predictor: "off" } as const;

test("without overscan a turn leaves a strip uncovered, with enough nothing", () => {
  expect(replay(turn(0), { ...OFF, overscan: 0 })).toEqual({ uncovered: 0, pixels: 1 });
  const { uncovered, pixels } = replay(turn(60), { ...OFF, overscan: 0 }); // 6 of about 90 degrees
  expect(uncovered).toBeGreaterThan(0.04);
  expect(uncovered).toBeLessThan(0.12);
  expect(pixels).toBe(1);
  expect(replay(turn(60), { ...OFF, overscan: 0.15 }).uncovered).toBe(0);
});

test("auto asks for what an even turn needs, for less than the most", () => {
  const auto = replay(turn(60), { ...OFF, overscan: "auto" });
  expect(auto.uncovered).toBeLessThan(0.3 * replay(turn(60), { ...OFF, overscan: 0 }).uncovered);
  expect(auto.pixels).toBeLessThan(replay(turn(60), { ...OFF, overscan: 0.25 }).pixels);
});

test("prediction of an even turn leaves next to nothing uncovered", () => {
  const { uncovered } = replay(turn(60), { age: 100, predictor: "velocity", overscan: 0 });
  expect(uncovered).toBeLessThan(0.02);
});
