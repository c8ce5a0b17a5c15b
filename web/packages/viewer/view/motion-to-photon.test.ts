import { expect, test } from "vitest";
import { MotionToPhoton } from "./motion-to-photon";

test("a frame shows the input that it was rendered from", () => {
  const subject = new MotionToPhoton();
  subject.sampled(1, 100);
  expect(subject.presented(1, 160)).toEqual([60]);
});

test("inputs whose own frames were never shown count until a later one is", () => {
  const subject = new MotionToPhoton();
  for (const version of [1, 2, 3]) subject.sampled(version, version * 16);
  expect(subject.presented(2, 100)).toEqual([84, 68]);
  expect(subject.presented(3, 120)).toEqual([72]);
});

test("an input counts once: at the first frame that shows it", () => {
  const subject = new MotionToPhoton();
  subject.sampled(1, 0);
  subject.presented(1, 50);
  expect(subject.presented(2, 70)).toEqual([]);
});

test("an older frame shows no newer input", () => {
  const subject = new MotionToPhoton();
  subject.sampled(5, 0);
  expect(subject.presented(4, 50)).toEqual([]);
  expect(subject.presented(5, 90)).toEqual([90]);
});

test("after a reset nothing waits", () => {
  const subject = new MotionToPhoton();
  subject.sampled(1, 0);
  subject.reset();
  expect(subject.presented(1, 60_000)).toEqual([]);
});

test("what waits is bounded", () => {
  const subject = new MotionToPhoton();
  for (let version = 0; version < MotionToPhoton.MAX_WAITING + 500; version++) subject.sampled(version, 0);
  expect(subject.presented(1e9, 1)).toHaveLength(MotionToPhoton.MAX_WAITING);
});
