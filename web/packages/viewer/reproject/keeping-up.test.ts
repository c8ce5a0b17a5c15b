import { expect, test } from "vitest";
import { KeepingUp } from "./keeping-up";

/** Whether it keeps up after a number of animation frames, `interval` milliseconds apart, each with a draw. */
function after(frames: number, interval: number, subject = new KeepingUp()): boolean {
  let keeps = true;
  for (let i = 0; i < frames; i++) keeps = subject.drawn(1000 + i * interval);
  return keeps;
}

test("30 frames a second are enough, five are not", () => {
  expect(after(500, 33)).toBe(true);
  expect(after(40, 200)).toBe(false);
  expect(after(12, 400)).toBe(false);
});

test("after three draws that are far too slow nobody waits for more, unless turning is forced", () => {
  expect(after(3, 400)).toBe(true);
  expect(after(4, 400)).toBe(false);
  expect(after(4, 400, new KeepingUp(true))).toBe(true);
  expect(after(11, 400, new KeepingUp(true))).toBe(false);
});

test("a few slow frames say nothing, nor does a page that is busy with something else", () => {
  expect(after(20, 200)).toBe(true);
  expect(after(100, 5000)).toBe(true);
});

test("what passes while nothing is drawn does not count", () => {
  const subject = new KeepingUp();
  for (let i = 0; i < 100; i++) {
    expect(subject.drawn(i * 500)).toBe(true);
    subject.rested();
  }
});
