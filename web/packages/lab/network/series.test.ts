import { expect, test } from "vitest";
import { NO_STATS } from "#viewer/stateless/stats";
import { frames, stepPath } from "./series";

test("a still picture has neither size nor latency", () => {
  const stats = {
    ...NO_STATS,
    shown: 7,
    roundTrip: 40,
    frame: { bytes: 52_000, width: 1, height: 1, profile: 0 },
  };
  expect(frames(stats, 6)).toEqual([52, 40]);
  expect(frames(stats, 7)).toEqual([null, null]);
});

test("a trace is drawn as steps, its highest rate at the top", () => {
  expect(stepPath([0, 500], [10, 5], 1000, [100, 20])).toBe("M0 0.0H50.0V10.0H100.0");
});

test("an outage from start to end is a line at the bottom", () => {
  expect(stepPath([0], [0], 1000, [100, 20])).toBe("M0 20.0H100.0");
});
