import { expect, test } from "vitest";
import { TimeWindow } from "./window";

test("percentiles are values that were there (nearest rank)", () => {
  const subject = new TimeWindow(1000);
  for (let i = 1; i <= 100; i++) subject.add(i, i);
  expect(subject.percentile(0.5, 100)).toBe(50);
  expect(subject.percentile(0.95, 100)).toBe(95);
  expect(subject.percentile(0, 100)).toBe(1);
  expect(subject.percentile(1, 100)).toBe(100);
});

test("what is older than the window is forgotten", () => {
  const subject = new TimeWindow(1000);
  subject.add(1, 0);
  subject.add(2, 600);
  expect(subject.values(1100)).toEqual([2]);
  expect(subject.values(2000)).toEqual([]);
  expect(subject.percentile(0.5, 2000)).toBeNull();
});

test("the rate counts the gaps between entries", () => {
  const subject = new TimeWindow(1000);
  for (let at = 0; at <= 1000; at += 20) subject.add(1, at);
  expect(subject.rate(1000)).toBeCloseTo(50, 0);
  expect(subject.rate(5000)).toBe(0);
});
