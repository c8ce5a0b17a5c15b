import { expect, test } from "vitest";
import { PoseTimes } from "./pose-times";

test("a picture's age counts from when the camera was last where it was taken", () => {
  const times = new PoseTimes();
  for (let at = 0; at <= 100; at += 20) times.sampled(1, at);
  times.sampled(2, 120);
  times.sampled(3, 140);
  expect([times.age(1, 160), times.age(2, 160), times.age(3, 160)]).toEqual([60, 40, 20]);
});

test("nothing is known of a pose that was long ago, or before all", () => {
  const times = new PoseTimes();
  times.sampled(5, 0);
  times.sampled(6, 20_000);
  expect([times.age(4, 20_000), times.age(5, 20_000), times.age(6, 20_000)]).toEqual([null, null, 0]);
});
