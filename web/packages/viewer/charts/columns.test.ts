import { expect, test } from "vitest";
import { append, noColumns, SPAN_S } from "./columns";

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
