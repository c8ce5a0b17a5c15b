import { expect, test } from "vitest";
import { type Segment, segments } from "./segments";

type Wanted = Parameters<typeof segments>[0];
const WANTED: Wanted = { count: 5, length_s: 20, trace_s: 180, movement_s: 120, seed: 1 };
const found = (more: Partial<Wanted> = {}) => segments({ ...WANTED, ...more }) as readonly Segment[];

test("parts of trace and movement lie within them, do not overlap, and follow from the seed", () => {
  const parts = found();
  expect(parts).toHaveLength(5);
  for (const [name, total] of [
    ["trace_s", 180],
    ["movement_s", 120],
  ] as const) {
    const begins = parts.map((part) => part[name]).toSorted((a, b) => a - b);
    expect(begins[0]).toBeGreaterThanOrEqual(0);
    expect(begins.at(-1)).toBeLessThanOrEqual(total - 20);
    for (const [i, begin] of begins.slice(1).entries()) {
      expect(begin - (begins[i] ?? 0)).toBeGreaterThanOrEqual(20 - 1e-3);
    }
  }
  expect(found()).toEqual(parts);
  expect(found({ seed: 2 })).not.toEqual(parts);
});

test("a short movement's parts overlap, and a constant link has no parts", () => {
  const parts = found({ movement_s: 40, trace_s: null });
  expect(parts.map(({ trace_s }) => trace_s)).toEqual([0, 0, 0, 0, 0]);
  expect(parts.map(({ movement_s }) => movement_s).toSorted((a, b) => a - b)).toEqual([0, 5, 10, 15, 20]);
});

test("a single part is the beginning of both, however short they are", () => {
  expect(found({ count: 1, movement_s: 1, trace_s: 1 })).toEqual([{ trace_s: 0, movement_s: 0 }]);
});

test.each([
  [{ trace_s: 99 }, "The trace has room for 4 parts of 20 s, not for 5."],
  [{ movement_s: 19.96 }, "The movement lasts 20.0 s, less than a run’s 20 s."],
])("%j has no room", (more, sentence) => {
  expect(found(more)).toBe(sentence);
});
