import { expect, test } from "vitest";
import { Meter, NO_FIGURES, PoseTimes } from "./meter";
import type { PresentedFrame } from "./presented";

const PICTURE = { rung: 2, width: 640, height: 360 };

test("figures are of the last seconds, and every frame is told to the listener with what it shows first", () => {
  const told: PresentedFrame[] = [];
  const meter = new Meter("dash", (frame) => told.push(frame));
  for (let i = 0; i < 40; i++) {
    meter.moved(i, i * 50);
    meter.sampled(i, i * 50);
    meter.received(10_000, i * 50);
    meter.presented({ ...PICTURE, pose: i, at: i * 50 + 60 });
  }
  expect(meter.figures(2010)).toMatchObject({
    motionToPhoton: { p50: 60, p95: 60 },
    bandwidth: 1_560_000,
    shown: 40,
    stalls: { count: 0, time: 0 },
    picture: PICTURE,
  });
  expect(meter.figures(2010).newViewsPerSecond).toBeCloseTo(20, 0);
  expect(told[7]).toEqual({ ...PICTURE, side: "dash", at: 410, pose: 7, latencies: [60] });
  meter.sampled(39, 60_000);
  const rested = { newViewsPerSecond: 0, motionToPhoton: { p50: 60, p95: 60 }, bandwidth: 0, shown: 40, frozenFor: 0 };
  expect(meter.figures(60_000)).toMatchObject(rested);
});

test.each([
  ["moves on", 1000],
  ["has stopped", 20],
])("while nothing is answered, latency and age of a camera that %s grow, and the picture is frozen", (_, inputs) => {
  const after = (seconds: number) => {
    const meter = new Meter("stateless", () => undefined);
    const frames = 14 + seconds * 20;
    for (let frame = 0; frame <= frames; frame++) {
      if (frame < inputs) meter.moved(frame, frame * 50);
      meter.sampled(Math.min(frame, inputs - 1), frame * 50);
      if (frame > 0 && frame < 15) meter.presented({ ...PICTURE, pose: frame - 1, at: frame * 50 });
    }
    return meter.figures(frames * 50);
  };
  expect(after(0)).toMatchObject({ motionToPhoton: { p50: 50, p95: 50 }, frozenFor: 0 });
  const frozen = [1, 2, 4, 8, 20].map(after);
  expect(frozen.map(({ frozenFor }) => frozenFor)).toEqual([1000, 2000, 4000, 8000, 20_000]);
  const ages = frozen.map(({ contentAge }) => contentAge ?? 0);
  expect(ages).toEqual(ages.toSorted((a, b) => a - b));
  expect(ages[0]).toBeGreaterThanOrEqual(1000);
  const p95 = frozen.map(({ motionToPhoton }) => motionToPhoton?.p95 ?? 0);
  expect(p95).toEqual(p95.toSorted((a, b) => a - b));
  expect(p95[0]).toBeGreaterThan(500);
});

test("no figure includes the time in which the page was hidden", () => {
  const meter = new Meter("stateless", () => undefined);
  for (let pose = 1; pose <= 50; pose++) {
    meter.moved(pose, pose * 20);
    meter.sampled(pose, pose * 20);
    if (pose > 2) meter.presented({ ...PICTURE, pose: pose - 2, at: pose * 20 + 8 });
  }
  meter.resumed(30_000);
  meter.sampled(50, 31_010);
  for (let pose = 51; pose <= 60; pose++) {
    const at = 31_010 + (pose - 50) * 20;
    meter.moved(pose, at);
    meter.sampled(pose, at);
    meter.presented({ ...PICTURE, pose: pose - 2, at: at + 8 });
  }
  const { motionToPhoton, contentAge, frozenFor, stalls } = meter.figures(31_220);
  expect(motionToPhoton?.p95).toBeLessThan(60);
  expect(contentAge).toBeLessThan(60);
  expect(frozenFor).toBeLessThan(60);
  expect(stalls).toEqual({ count: 0, time: 0 });
});

test("a mode that was left was not frozen", () => {
  const meter = new Meter("stateless", () => undefined);
  meter.presented({ ...PICTURE, pose: 1, at: 10 });
  meter.sampled(2, 20);
  meter.reset();
  expect(meter.figures(70_000).frozenFor).toBe(0);
});

test("a frame of a pose that is shown already tells no latency", () => {
  const told: (readonly number[])[] = [];
  const meter = new Meter("dash", ({ latencies }) => told.push(latencies));
  meter.moved(1, 0);
  meter.presented({ ...PICTURE, pose: 1, at: 80 });
  meter.presented({ ...PICTURE, pose: 1, at: 113 });
  expect(told).toEqual([[80], []]);
});

test("repeated frames are no new views, and do not hide a stall", () => {
  const meter = new Meter("dash", () => undefined);
  for (let at = 0; at <= 1000; at += 20) {
    meter.moved(at, at);
    meter.presented({ ...PICTURE, pose: at > 200 && at < 800 ? 200 : at, at });
  }
  expect(meter.figures(1000).stalls).toEqual({ count: 1, time: 600 });
  expect(meter.figures(1000)).toMatchObject({ newViewsPerSecond: expect.closeTo(20.4, 1), shown: 51 });
});

test("before anything is shown there are no figures", () => {
  expect(new Meter("stateless", () => undefined).figures(1000)).toEqual(NO_FIGURES);
});

test("a picture's age counts from when the camera was last where it was taken", () => {
  const times = new PoseTimes();
  for (let at = 0; at <= 100; at += 20) times.sampled(1, at);
  times.sampled(2, 120);
  times.sampled(3, 140);
  expect([times.age(1, 160), times.age(2, 160), times.age(3, 160)]).toEqual([60, 40, 20]);
});

test("nothing is known of a pose that was long ago, or before all", () => {
  const times = new PoseTimes();
  times.sampled(5, 0);
  times.sampled(6, 20_000);
  expect([times.age(4, 20_000), times.age(5, 20_000), times.age(6, 20_000)]).toEqual([null, null, 0]);
});
