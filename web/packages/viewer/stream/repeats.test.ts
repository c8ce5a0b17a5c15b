import { expect, test } from "vitest";
import { repeatedShare } from "./repeats";

const counts = (frames: number, repeated: number, dropped = 0, id = "a") => ({ id, frames, repeated, dropped });

test.each([
  ["frames that all show something new", counts(10, 4), counts(70, 4), 0],
  ["every other frame repeated", counts(10, 4), counts(70, 34), 0.5],
  ["frames that were skipped", counts(0, 0), counts(30, 0, 30), 0.5],
])("%s", (_, before, after, share) => {
  expect(repeatedShare(before, after)).toBe(share);
});

test("of another stream, of none, or of no time nothing is told", () => {
  expect(repeatedShare(null, counts(9, 9))).toBeNull();
  expect(repeatedShare(counts(9, 9), null)).toBeNull();
  expect(repeatedShare(counts(9, 9), counts(9, 9))).toBeNull();
  expect(repeatedShare(counts(9, 9), counts(90, 9, 0, "b"))).toBeNull();
});
