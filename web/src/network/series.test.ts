import { expect, test } from "vitest";
import { NO_STATS } from "../player/stats";
import { append, frames, noColumns, SPAN, stepPath } from "./series";

test("remembers one minute", () => {
  let columns = noColumns(2);
  for (let t = 0; t <= 100; t++) columns = append(columns, t, [t, t * 2]);
  const [times, first, second] = columns;
  expect(times).toHaveLength(SPAN + 1);
  expect(times.at(0)).toBe(40);
  expect(first?.at(0)).toBe(40);
  expect(second?.at(-1)).toBe(200);
});

test("draws no line across a time without samples", () => {
  const columns = append(append(noColumns(1), 0, [5]), 10, [6]);
  expect(columns).toEqual([
    [0, 9, 10],
    [5, null, 6],
  ]);
});

test("after a long silence only the new sample is left, with the break before it", () => {
  expect(append(append(noColumns(1), 0, [5]), 500, [6])).toEqual([
    [499, 500],
    [null, 6],
  ]);
});

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
