import { expect, test } from "vitest";
import { PAPER_LADDER } from "./ladder";
import { ServerTimes } from "./server-times";

const timing = (render: number, queue = 0, encode = 0) => ({ queue, render, encode });

test("unknown servers take no time, and one that is known at one rung takes as long at all", () => {
  const subject = new ServerTimes(PAPER_LADDER);
  expect(subject.expected(0)).toEqual({ total: 0, stage: 0 });
  subject.observe(3, timing(10, 3, 2), 0);
  for (const rung of [0, 3]) expect(subject.expected(rung)).toMatchObject({ total: 15, stage: 10 });
});

// Rungs 3, 2, 1 and 0 have 1, 4, 9 and 16 times the pixels of the lowest.
test("a rung that was not seen is on the line through the two nearest that were", () => {
  const subject = new ServerTimes(PAPER_LADDER);
  subject.observe(3, timing(5), 0);
  subject.observe(2, timing(11), 0);
  expect(subject.expected(1).total).toBeCloseTo(21, 9);
  expect(subject.expected(0).stage).toBeCloseTo(35, 9);
  subject.observe(1, timing(41), 0);
  expect(subject.expected(0).total).toBeCloseTo(83, 9);
});

test("rungs of the same size take as long, whatever their JPEG quality", () => {
  const [large, , , small] = PAPER_LADDER;
  if (large === undefined || small === undefined) throw new Error("no ladder");
  const subject = new ServerTimes([large, small, { ...small, quality: 5 }]);
  subject.observe(2, timing(10), 0);
  subject.observe(1, timing(20), 10);
  for (const rung of [1, 2]) expect(subject.expected(rung).total).toBeCloseTo(15, 9);
});

test("no time is less than none", () => {
  const subject = new ServerTimes(PAPER_LADDER);
  subject.observe(1, timing(1), 0);
  subject.observe(0, timing(90), 0);
  expect(subject.expected(3).total).toBe(0);
});

test("a rung's own time is the moving average of its frames, the first five alike, until none came for long", () => {
  const subject = new ServerTimes(PAPER_LADDER);
  for (const [i, time] of [8, 9, 10, 11, 12].entries()) subject.observe(2, timing(time), i);
  expect(subject.expected(2).total).toBeCloseTo(10, 9);
  subject.observe(2, timing(20), 10);
  expect(subject.expected(2).total).toBeCloseTo(12, 9);
  subject.observe(3, timing(4), 15_000);
  expect(subject.expected(2).total).toBeCloseTo(12, 9);
  subject.observe(3, timing(4), 15_011);
  expect(subject.expected(2).total).toBe(4);
});

test("a size that was left in a slow moment is not remembered by it: all become faster alike", () => {
  const subject = new ServerTimes(PAPER_LADDER);
  const hear = (rung: number, render: number, frames: number) => {
    for (let i = 0; i < frames; i++) subject.observe(rung, timing(render), 0);
  };
  hear(1, 90, 20);
  hear(3, 30, 5);
  expect(subject.expected(1)).toMatchObject({ total: 90, stage: 90 });
  hear(3, 10, 100);
  expect(subject.expected(3).stage).toBeCloseTo(10, 3);
  expect(subject.expected(1).stage).toBeCloseTo(30, 3);
  expect(subject.expected(1).total).toBeCloseTo(30, 3);
});

test("frames of unknown rungs and without timing say nothing", () => {
  const subject = new ServerTimes(PAPER_LADDER);
  subject.observe(null, timing(9), 0);
  subject.observe(9, timing(9), 0);
  subject.observe(0, null, 0);
  expect(subject.expected(0).total).toBe(0);
});
