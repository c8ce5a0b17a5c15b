import { describe, expect, test } from "vitest";
import { Pace } from "./pace";

/** A pace for a display with this frame rate, once that is known. */
function pace(hertz = 60): Pace {
  const subject = new Pace();
  for (let i = 0; i < 40; i++) subject.tick((i * 1000) / hertz);
  return subject;
}

const observed = (subject: Pace, times: readonly number[]) => times.map((time) => subject.observe(time));
const frames = (count: number, time: number) => Array<number>(count).fill(time);

test("frames that take less than the display's interval are never too slow", () => {
  expect(new Set(observed(pace(), frames(200, 15)))).toEqual(new Set([null]));
});

test("what takes a little longer is told after fifteen frames, and by how much", () => {
  expect(observed(pace(), frames(15, 18))).toEqual([...frames(14, 0).map(() => null), 18]);
});

test("what takes far longer is told after five", () => {
  expect(observed(pace(), frames(5, 300))).toEqual([null, null, null, null, 300]);
});

test.each([
  ["the first frames, which compile shaders", [900, 400, ...frames(40, 5)]],
  ["every fifth frame", Array.from({ length: 100 }, (_, i) => (i % 5 ? 5 : 200))],
])("%s may be slow", (_, times) => {
  expect(new Set(observed(pace(), times))).toEqual(new Set([null]));
});

describe("the display's rate counts", () => {
  test("9 ms are too long at 120 Hz", () => {
    expect(observed(pace(120), frames(15, 9)).at(-1)).toBe(9);
  });

  test("25 ms are not at 30 Hz", () => {
    expect(observed(pace(30), frames(15, 25)).at(-1)).toBeNull();
  });

  test("a processor that is too busy slows down the animation frames, which is no excuse", () => {
    const subject = pace();
    for (let i = 0; i < 100; i++) subject.tick(1000 + i * 50);
    expect(subject.interval).toBeCloseTo(16.7, 1);
  });
});

test("another model begins anew", () => {
  const subject = pace();
  observed(subject, frames(14, 18));
  subject.reset();
  expect(observed(subject, frames(14, 18)).at(-1)).toBeNull();
});
