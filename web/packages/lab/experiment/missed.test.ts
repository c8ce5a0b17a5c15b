import { expect, test } from "vitest";
import { displayInterval, intervalAtRest, missedFrames } from "./missed";

const every = (interval: number, count: number, jitter = 0) =>
  Array.from({ length: count }, (_, i) => i * interval + (i % 2) * jitter);

test.each([
  ["steady", every(20, 50), 20],
  ["jittering", every(20, 51, 4), 20],
  [
    "that misses every other frame for most of the time",
    [...every(20, 12), ...every(40, 40).map((at) => at + 260)],
    20,
  ],
])("the interval of a display %s", (_, times, interval) => {
  expect(displayInterval(times)).toBe(interval);
});

test("the interval at rest is the usual one, and unknown with few frames", () => {
  expect(intervalAtRest([...every(20, 30), 800, 803])).toBe(20);
  expect(intervalAtRest(every(20, 20))).toBeNull();
});

test("one animation frame has no interval, nor have two at the same time", () => {
  expect([displayInterval([]), displayInterval([5]), displayInterval([5, 5])]).toEqual([null, null, null]);
});

test.each([
  ["none in a steady loop", [0, 20, 40, 60], []],
  ["none where a frame comes a little late", [0, 20, 49, 60], []],
  ["one in a double gap", [0, 20, 60, 80], [40]],
  ["all in a stall, at the display's own times", [0, 20, 121], [40, 60, 80, 100]],
])("frames are missed: %s", (_, times, missed) => {
  expect(missedFrames(times, 20)).toEqual(missed);
});
