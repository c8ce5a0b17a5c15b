import { beforeEach, expect, test } from "vitest";
import { StallDetector } from "./stalls";

let detector: StallDetector;

beforeEach(() => {
  detector = new StallDetector();
});

/** Moves at 60 Hz over a span. */
function move(from: number, to: number): void {
  for (let at = from; at <= to; at += 16) detector.moved(at);
}

test("a gap in the picture while the camera moves is a stall, with its whole length", () => {
  move(0, 1000);
  detector.presented(100);
  detector.presented(133);
  detector.presented(633);
  expect(detector.stalls(633)).toEqual({ count: 1, time: 500 });
});

test("a stall lasts no longer than the movement", () => {
  move(0, 480);
  detector.presented(80);
  detector.presented(3000);
  expect(detector.stalls(3000)).toEqual({ count: 1, time: 400 });
});

test("frames that come steadily are none, however late they show a movement", () => {
  for (let at = 0; at < 2000; at += 33) {
    if (at > 1000) detector.moved(at);
    detector.presented(at);
  }
  expect(detector.stalls(2000).count).toBe(0);
});

test("a still camera needs no frames, and the wait for the first one after it is latency, not a stall", () => {
  move(0, 200);
  detector.presented(200);
  move(5000, 5400);
  detector.presented(5300);
  detector.presented(5330);
  expect(detector.stalls(5330).count).toBe(0);
});

test("a stall counts while it goes on, once", () => {
  move(0, 1008);
  detector.presented(16);
  expect(detector.stalls(200)).toEqual({ count: 0, time: 0 });
  expect(detector.stalls(516)).toEqual({ count: 1, time: 500 });
  detector.presented(716);
  expect(detector.stalls(716)).toEqual({ count: 1, time: 700 });
});
