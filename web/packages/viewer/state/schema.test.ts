import { expect, test } from "vitest";
import { BOOLEAN, either, nullable, numberWithin, oneOf, record, wholeWithin } from "./schema";

const RUNG = record({ rung: wholeWithin(0, 3), share: numberWithin(0, 0.5) });

test.each([
  ["a boolean", BOOLEAN, [true, false], ["true", 1, null, undefined]],
  ["one of a list", oneOf(["a", "b"]), ["a", "b"], ["c", "", 0, null]],
  ["a number within limits", numberWithin(0, 0.5), [0, 0.25, 0.5], [-0.1, 0.6, Number.NaN, "0.2", null]],
  ["a whole number", wholeWithin(1, 60), [1, 60], [0, 61, 1.5, "2"]],
  ["a value or null", nullable(oneOf([30, 60])), [30, null], [31, undefined]],
  ["either of two", either(oneOf(["auto"]), numberWithin(0, 1)), ["auto", 0.5], ["on", 2]],
  ["a record", RUNG, [{ rung: 1, share: 0.1 }], [null, {}, { rung: 1 }, { rung: 1, share: 0.1, more: 1 }, "rung"]],
] as const)("%s", (_, { accepts }, valid, invalid) => {
  expect(valid.filter((value) => !accepts(value))).toEqual([]);
  expect(invalid.filter((value) => accepts(value))).toEqual([]);
});
