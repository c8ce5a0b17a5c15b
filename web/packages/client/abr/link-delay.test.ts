import { expect, test } from "vitest";
import { LinkDelay, RecentMinimum } from "./link-delay";
import { seeded } from "./random";

function heard(subject: LinkDelay, delays: readonly number[], from = 0): LinkDelay {
  for (const [i, delay] of delays.entries()) subject.observe(delay, from + i * 16);
  return subject;
}

test("the queue is the delay above the recent minimum", () => {
  const subject = heard(new LinkDelay(), Array(20).fill(40));
  expect(subject.queue).toBe(0);
  heard(subject, Array(30).fill(90), 320);
  expect(subject.queue).toBeCloseTo(50, 0);
});

test("jitter is no queue: it is how much the delay changes from frame to frame", () => {
  const random = seeded(1);
  const subject = heard(
    new LinkDelay(),
    Array.from({ length: 200 }, () => 40 + 20 * random()),
  );
  expect(subject.jitter).toBeGreaterThan(4);
  expect(subject.jitter).toBeLessThan(10);
  expect(subject.queue).toBeLessThan(12);
});

test("after a restart only new frames count, and not before there are some", () => {
  const subject = heard(new LinkDelay(), [...Array(20).fill(40), ...Array(20).fill(90)]);
  subject.restart();
  expect([subject.queue, subject.frames]).toEqual([0, 0]);
  heard(subject, Array(5).fill(60), 640);
  expect(subject.queue).toBeCloseTo(20, 9);
});

test("the least of the last milliseconds, and no older one", () => {
  const subject = new RecentMinimum(100);
  expect([5, 3, 4, 9].map((value, i) => subject.add(value, 10 * i))).toEqual([5, 3, 3, 3]);
  expect(subject.add(8, 109)).toBe(3);
  expect(subject.add(8, 110)).toBe(4);
  expect(subject.add(8, 121)).toBe(8);
});
