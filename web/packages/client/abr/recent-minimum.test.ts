import { expect, test } from "vitest";
import { RecentMinimum } from "./recent-minimum";

test("the least of the last milliseconds, and no older one", () => {
  const subject = new RecentMinimum(100);
  expect([5, 3, 4, 9].map((value, i) => subject.add(value, 10 * i))).toEqual([5, 3, 3, 3]);
  expect(subject.add(8, 109)).toBe(3);
  expect(subject.add(8, 110)).toBe(4);
  expect(subject.add(8, 121)).toBe(8);
});
