import { expect, test } from "vitest";
import { NO_FIGURES } from "../view/meter";
import { LATENCY_BINS_MS } from "./histogram";
import { ComparisonHistory } from "./history";

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
  expect(history.bandwidth.value).toEqual([
    [1, 1.25],
    [4, 4],
    [null, 1],
  ]);
  expect(history.newViews.value.slice(1)).toEqual([
    [48, 48],
    [null, 48],
  ]);
  expect(history.stalled.value.slice(1)).toEqual([
    [0.5, 0.5],
    [null, 0.5],
  ]);
  expect(history.buffered.value.slice(1)).toEqual([
    [null, null], // it has none
    [null, 140],
  ]);
  expect(history.lines.value.slice(1)).toEqual([
    [360, 360],
    [null, 360],
  ]);
});

test("latencies are distributed side by side, and forgotten after a minute", () => {
  const history = new ComparisonHistory(2);
  history.presented(0, { at: 0, latencies: [50, 51] });
  history.presented(1, { at: 0, latencies: [700] });
  history.sample([FIGURES, FIGURES], 100);
  const [, left, right] = history.latency.value;
  expect([left?.[bin(50)], right?.[bin(700)]]).toEqual([100, 100]);
  history.sample([FIGURES, FIGURES], 61_000);
  expect(
    history.latency.value
      .slice(1)
      .flat()
      .every((value) => value === null),
  ).toBe(true);
});
