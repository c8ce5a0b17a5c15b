import { expect, test } from "vitest";
import { FrameClock } from "./frame-clock";

test("60 a second until some animation frames have come, then as they come", () => {
  const subject = new FrameClock();
  for (let i = 0; i < 3; i++) subject.tick(i * 8);
  expect(subject.interval).toBeCloseTo(1000 / 60, 9);
  for (let i = 3; i < 10; i++) subject.tick(i * 8);
  expect(subject.interval).toBe(8);
});

test("late frames and hidden pages do not change it, another display does", () => {
  const subject = new FrameClock();
  let now = 0;
  const tick = (interval: number) => {
    now += interval;
    subject.tick(now);
  };
  for (const interval of [...Array(10).fill(8), 24, 60_000, 0, ...Array(5).fill(8)]) tick(interval);
  expect(subject.interval).toBe(8);
  for (let i = 0; i < 31; i++) tick(20);
  expect(subject.interval).toBe(20);
});
