import { beforeEach, expect, test } from "vitest";
import { LinkRate } from "./link-rate";

const PACE = 20;
let subject: LinkRate;
let at: number;

beforeEach(() => {
  subject = new LinkRate();
  at = 0;
  hear(1, { network: 20 });
});

interface Frames {
  readonly bytes?: number;
  readonly network?: number;
  readonly transmission?: number;
  readonly interval?: number;
}

function hear(frames: number, { bytes = 5000, network = 20, transmission = 2, interval = PACE }: Frames): number {
  for (let i = 0; i < frames; i++) {
    at += interval;
    subject.observe({ bytes, network, transmission, pace: PACE, at });
  }
  return subject.bitsPerSecond;
}

test("frames that come as fast as they are asked for count with their transmission", () => {
  expect(hear(100, {})).toBeCloseTo((5000 * 8000) / 2, -3);
});

test("frames that come further apart have been on the link meanwhile, however fast their own bytes came", () => {
  const rate = hear(50, { interval: 120, network: 300 });
  expect(rate).toBeCloseTo((5000 * 8000) / 100, -3);
  expect(hear(20, { interval: 60, network: 300 })).toBeGreaterThan(1.4 * rate);
});

test("frames that were not asked for are not waited for", () => {
  expect(hear(100, { interval: 3000 })).toBeCloseTo((5000 * 8000) / 2, -3);
});

test("an outage counts with all frames of about a second", () => {
  const before = hear(100, {});
  const after = hear(1, { interval: 800, network: 800 });
  expect(after).toBeLessThan(before / 10);
  expect(hear(250, {})).toBeGreaterThan(before / 2);
});
