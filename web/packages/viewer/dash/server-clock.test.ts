import { expect, test } from "vitest";
import { ServerClock } from "./server-clock";

test("the answer that took the shortest way counts", () => {
  const clock = new ServerClock();
  expect(clock.at(0)).toBeNaN();
  clock.heard(10_300, 0, 400); // 10 100 ahead, if the answer took half the time
  expect(clock.at(0)).toBe(10_100);
  clock.heard(10_510, 500, 520); // 10 000 ahead
  clock.heard(10_700, 600, 900);
  expect(clock.at(1000)).toBe(11_000);
});

test("old answers are forgotten, since clocks drift apart", () => {
  const clock = new ServerClock();
  clock.heard(1000, 0, 0);
  for (let i = 1; i <= 8; i++) clock.heard(i * 100, i * 100, i * 100 + 2);
  expect(clock.at(5000)).toBe(4999);
});
