import { expect, test } from "vitest";
import { Meter, NO_FIGURES } from "./meter";
import type { PresentedFrame } from "./presented";

const PICTURE = { rung: 2, width: 640, height: 360 };

test("figures are of the last seconds, and every frame is told to the listener with what it shows first", () => {
  const told: PresentedFrame[] = [];
  const meter = new Meter("dash", (frame) => told.push(frame));
  for (let i = 0; i < 40; i++) {
    meter.moved(i, i * 50);
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
  expect(meter.figures(60_000)).toMatchObject({ newViewsPerSecond: 0, motionToPhoton: null, bandwidth: 0, shown: 40 });
});

test("a frame of a pose that is shown already tells no latency", () => {
  const meter = new Meter("dash", () => undefined);
  meter.moved(1, 0);
  meter.presented({ ...PICTURE, pose: 1, at: 80 });
  meter.presented({ ...PICTURE, pose: 1, at: 113 });
  expect(meter.latencies(120)).toEqual([80]);
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
