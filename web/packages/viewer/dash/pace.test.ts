import { beforeEach, describe, expect, test } from "vitest";
import { Pace, ServerClock } from "./pace";

let pace: Pace;

beforeEach(() => {
  pace = new Pace();
});

/** The pace this many milliseconds behind a live edge at 10 s, with a target of 60 ms and a buffer up to `end`. */
function at(behind: number, end = 10, live = 10) {
  return pace.next({ position: live - behind / 1000, end, live, target: 0.06 });
}

test("playback is faster above the target and slower below, until it has crossed it", () => {
  expect(at(65)).toEqual({ rate: 1 });
  expect(at(80)).toEqual({ rate: 1.05 });
  expect(at(65)).toEqual({ rate: 1.05 });
  expect(at(59)).toEqual({ rate: 1 });
  expect(at(40)).toEqual({ rate: 0.95 });
  expect(at(55)).toEqual({ rate: 0.95 });
  expect(at(61)).toEqual({ rate: 1 });
});

test("what is far behind jumps to just before the end of what has come", () => {
  expect(at(500)).toEqual({ jump: 9.98 });
});

test("it does not jump again at once", () => {
  at(500);
  expect(at(400)).toEqual({ rate: 1.05 });
  expect(at(400, 13, 13)).toEqual({ jump: 12.98 });
});

test("nothing has come to jump to, or to hurry to, where the link itself is late", () => {
  expect(at(500, 9.6)).toEqual({ rate: 1.05 });
  expect(at(500, 9.51)).toEqual({ rate: 1 });
});

describe("server clock", () => {
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
});
