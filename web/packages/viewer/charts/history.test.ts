import { expect, test } from "vitest";
import { NO_FIGURES } from "../view/meter";
import { append, ComparisonHistory, LATENCY_BINS_MS, noColumns, SPAN_S } from "./history";

const FIGURES = {
  ...NO_FIGURES,
  newViewsPerSecond: 48,
  bandwidth: 4_000_000,
  stalls: { count: 2, time: 500 },
  picture: { rung: 2, width: 640, height: 360 },
};
/** The index of the bin that a latency falls in. */
const bin = (latency: number) => LATENCY_BINS_MS.filter((from) => from <= latency).length - 1;

test("samples become columns, one for each side; a side that is not shown has none", () => {
  const history = new ComparisonHistory(2);
  history.sample([FIGURES, null], 1000);
  history.sample([FIGURES, { ...FIGURES, bandwidth: 1_000_000, buffered: 140 }], 1250);
  expect(history.series.bandwidth.value).toEqual([
    [1, 1.25],
    [4, 4],
    [null, 1],
  ]);
  expect(history.series.newViews.value.slice(1)).toEqual([
    [48, 48],
    [null, 48],
  ]);
  expect(history.series.stalled.value.slice(1)).toEqual([
    [0.5, 0.5],
    [null, 0.5],
  ]);
  expect(history.series.buffered.value.slice(1)).toEqual([
    [null, null], // it has none
    [null, 140],
  ]);
  expect(history.series.lines.value.slice(1)).toEqual([
    [360, 360],
    [null, 360],
  ]);
});

test("latencies are distributed side by side, those off the axis at its ends, and forgotten after a minute", () => {
  const history = new ComparisonHistory(2);
  history.presented(0, { at: 0, latencies: [50, 51, 0, 1e9] });
  history.presented(1, { at: 0, latencies: [700] });
  history.sample([FIGURES, FIGURES], 100);
  const [, left, right] = history.latency.value;
  expect([left?.[bin(50)], left?.[0], left?.[LATENCY_BINS_MS.length - 1], right?.[bin(700)]]).toEqual([
    50, 25, 25, 100,
  ]);
  history.sample([FIGURES, FIGURES], 61_000);
  const [, ...sides] = history.latency.value;
  expect(new Set(sides.flat())).toEqual(new Set([null]));
});

test("remembers one minute", () => {
  let columns = noColumns(2);
  for (let t = 0; t <= 100; t++) columns = append(columns, t, [t, t * 2]);
  const [times, first, second] = columns;
  expect(times).toHaveLength(SPAN_S + 1);
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
