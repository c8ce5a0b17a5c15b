import { beforeEach, expect, test } from "vitest";
import { observation } from "./fake-observation";
import { ViewController } from "./view";
import type { Way } from "./view-error";

const FRAME = 1000 / 60;
/** Each rung takes twice the bytes of the next, for 3 dB. */
const LADDER = [160, 80, 40, 20, 10, 5].map((expected_kb, i) => ({
  name: `${i}`,
  width: 1280 / (i + 1),
  height: 720 / (i + 1),
  quality: 80,
  expected_kb,
  psnr_db: 42 - 3 * i,
}));
let subject: ViewController;
let now: number;

beforeEach(() => {
  subject = new ViewController({ ladder: LADDER });
  now = 0;
});

interface Circumstances {
  /** Milliseconds there and back. */
  readonly trip?: number;
  readonly throughput?: number | null;
  /** Degrees a second. */
  readonly turning?: number;
  readonly way?: Way;
  /** Bytes of frames, in those that the ladder expects: with margins they are larger. */
  readonly scale?: number;
}

/** Frames for so many milliseconds, one with each animation frame; the rungs that were asked for. */
function hear(duration: number, options: Circumstances = {}): number[] {
  const { trip = 50, throughput = 20e6, turning = 30, way = "predicted", scale = 1 } = options;
  const asked: number[] = [];
  for (const until = now + duration; now < until; now += FRAME) {
    const profile = subject.decide(now);
    const bytes = (LADDER[profile]?.expected_kb ?? 0) * 1000 * scale;
    const response = trip + 10 + (throughput === null ? 0 : (bytes * 8000) / throughput);
    subject.observe(observation({ profile, bytes, response, throughput, turning, way, at: now }));
    asked.push(profile);
  }
  return asked;
}

const after = (duration: number, options?: Circumstances) => hear(duration, options).at(-1) ?? -1;

test("the slower the camera turns, the better the picture, and the later it may be", () => {
  const slow = after(10_000, { turning: 15 });
  subject = new ViewController({ ladder: LADDER });
  const fast = after(10_000, { turning: 150 });
  expect(slow).toBeLessThan(fast);
  expect(fast).toBeGreaterThan(0);
});

test("time is dearer where there is much of it already", () => {
  const near = after(10_000, { trip: 20, turning: 60 });
  subject = new ViewController({ ladder: LADDER });
  expect(after(10_000, { trip: 300, turning: 60 })).toBeGreaterThan(near);
});

test("what is shown better when it is late may be later", () => {
  const rungs = (["predicted", "depth", "rotation", "stale"] as const).map((way) => {
    subject = new ViewController({ ladder: LADDER });
    return after(10_000, { way, turning: 30 });
  });
  expect(rungs).toEqual(rungs.toSorted());
  expect(rungs.at(-1)).toBeGreaterThan(rungs[0] ?? 0);
});

test("the bytes of margins count: frames that are larger by them make it choose a lesser rung", () => {
  const without = after(10_000, { throughput: 15e6, turning: 60 });
  subject = new ViewController({ ladder: LADDER });
  expect(after(10_000, { throughput: 15e6, turning: 60, scale: 2.25 })).toBeGreaterThan(without);
});

test("upwards it takes one rung at a time, downwards as many as needed at once", () => {
  const up = hear(10_000, { throughput: 200e6 });
  for (const [i, rung] of up.slice(1).entries()) expect((up[i] ?? 0) - rung).toBeLessThanOrEqual(1);
  expect(up.at(-1)).toBe(0);
  const down = hear(60, { throughput: 3e6 });
  expect((down.at(-1) ?? 0) - (down[0] ?? 0)).toBeGreaterThan(1);
});

test("a short halt does not change the picture, nor does a single sharp turn", () => {
  const before = after(10_000, { turning: 60 });
  expect(after(200, { turning: 0 })).toBe(before);
  expect(after(50, { turning: 300 })).toBe(before);
});

test("a rest says nothing of how fast the camera will turn", () => {
  const before = after(10_000, { turning: 90 });
  now += 60_000;
  expect(after(FRAME, { turning: 0 })).toBe(before);
  expect(after(100, { turning: 90 })).toBe(before);
});

test("nothing changes while the throughput is unknown", () => {
  expect(after(1000, { throughput: null })).toBe(LADDER.length - 1);
});

test("a ladder that says nothing of its pictures' quality is judged by its bytes", () => {
  subject = new ViewController({ ladder: LADDER.map((rung) => ({ ...rung, psnr_db: null })) });
  expect(after(10_000, { throughput: 100e6, turning: 15 })).toBeLessThan(2);
});
