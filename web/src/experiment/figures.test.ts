import { expect, test } from "vitest";
import { answers, figures, percentile } from "./figures";

const input = (at: number, pose: number) => ({ at, pose, position: [0, 0, 0], quaternion: [0, 0, 0, 1] });
const frame = (at: number, pose: number, rung: number | null = 0, height = 360) => ({
  side: "stateless" as const,
  at,
  pose,
  latencies: [],
  rung,
  width: 640,
  height,
});

test("an input is answered by the first frame of its pose or of a later one", () => {
  const inputs = [input(0, 1), input(10, 2), input(20, 3), input(30, 9)];
  const frames = [frame(5, 0), frame(40, 2), frame(60, 1), frame(90, 4)];
  expect(answers({ inputs, frames }).map(({ latency }) => latency)).toEqual([40, 30, 70, Number.POSITIVE_INFINITY]);
});

test("inputs that were never answered count as slower than any", () => {
  const inputs = [input(0, 1), input(10, 2)];
  const { p50, p95, interactive } = figures({
    inputs,
    frames: [frame(40, 1)],
    captures: [],
    traffic: [],
    duration_ms: 1000,
  });
  expect([p50, p95, interactive]).toEqual([40, null, 0.5]);
});

test("weights heights by time, counts frames and switches until the movement's end, and traffic from its first report", () => {
  const found = figures({
    inputs: [],
    frames: [frame(0, 0, 0, 720), frame(500, 1, 1, 360), frame(600, 2, null, 360), frame(1500, 3, 0, 720)],
    captures: [],
    traffic: [
      { at: 0, bytes: 0 },
      { at: 1000, bytes: 125_000 },
      { at: 2000, bytes: 900_000 },
    ],
    duration_ms: 1000,
  });
  expect(found).toEqual({
    p50: null,
    p95: null,
    interactive: null,
    framesPerSecond: 3,
    meanHeight: 540,
    switches: 1,
    received: 1e6,
  });
});

test("nothing that moves and nothing that comes is no figure, not zero", () => {
  const found = figures({ inputs: [], frames: [], captures: [], traffic: [], duration_ms: 1000 });
  expect([found.p50, found.interactive, found.meanHeight, found.received]).toEqual([null, null, null, null]);
});

test("percentiles are those of the nearest rank", () => {
  expect(percentile([4, 1, 3, 2], 0.5)).toBe(2);
  expect(percentile([4, 1, 3, 2], 0.95)).toBe(4);
  expect(percentile([], 0.5)).toBeNull();
});
