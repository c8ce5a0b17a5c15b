import { expect, test } from "vitest";
import { histogram, LATENCY_BINS_MS } from "./histogram";

/** The bins that hold something: where they begin (rounded), and how much. */
function filled(values: readonly number[]): [from: number, percent: number | null][] {
  return histogram(values).flatMap((percent, i) => (percent ? [[Math.round(LATENCY_BINS_MS[i] ?? 0), percent]] : []));
}

test("values are counted in the bin that they lie in, as a share of all", () => {
  expect(filled([100, 101, 120, 1000])).toEqual([
    [100, 75],
    [1000, 25],
  ]);
});

test("what is off the axis counts at its end, and nothing is lost", () => {
  const bins = histogram([0, 1, 9_000, 1e9]);
  expect([bins[0], bins.at(-1)]).toEqual([50, 50]);
});

test("without values there is no distribution", () => {
  expect(histogram([]).every((value) => value === null)).toBe(true);
});
