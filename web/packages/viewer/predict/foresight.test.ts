import { beforeEach, describe, expect, test } from "vitest";
import type { SceneInfo } from "#client/wire/render";
import { STILL, steeredRig } from "#fakes/rig";
import { orientation, type ScenePose } from "../view/camera";
import type { Rig } from "../view/rig";
import { angleBetween } from "../view/vector";
import { Foresight, LeadTime, Predictor } from "./foresight";
import type { PredictorName } from "./registry";
import { velocity } from "./velocity";

const SCENE = { up: [0, -1, 0], camera: { position: [0, 0, -4], look_at: [0, 0, 0] } } as SceneInfo;

let chosen: PredictorName;
let rig: Rig;
let foresight: Foresight;
let now: number;
let turning: number;

beforeEach(() => {
  chosen = "velocity";
  now = 1000;
  turning = 0;
  rig = steeredRig(() => ({ ...STILL, turnRight: turning }));
  rig.enter(SCENE);
  rig.drive((at) => ({ position: [at / 1000, 0, 0], quaternion: [0, 0, 0, 1] }));
  foresight = new Foresight(rig, () => chosen);
});

/** Animation frames every 10 ms, each with a frame that was requested 100 ms before; returns how far ahead the last one looks (m). */
function frames(count: number, arrive: (askedAt: number, now: number) => void): number {
  let [x] = rig.pose.position;
  for (let i = 0; i < count; i++) {
    now += 10;
    arrive(now - 100, now);
    rig.sample(now);
    [x] = foresight.pose(now).position;
  }
  return x - rig.pose.position[0];
}

test("looks as far ahead as frames take", () => {
  expect(frames(20, () => undefined)).toBe(0);
  expect(frames(20, (askedAt, at) => foresight.shown(askedAt, at))).toBeCloseTo(0.105, 6);
});

test("what is drawn now is drawn for when it is seen: one frame of the display later", () => {
  frames(20, () => undefined);
  const { position, seq } = foresight.onScreen(now);
  expect(position[0] - rig.pose.position[0]).toBeCloseTo(0.01, 6);
  expect(seq).toBe(rig.pose.seq);
  expect(foresight.onScreen(now + 10)).toBe(rig.pose); // nothing was requested in that animation frame
  chosen = "off";
  frames(1, () => undefined);
  expect(foresight.onScreen(now).position).toEqual(rig.pose.position);
});

test("another choice holds at once, and of another connection nothing is known", () => {
  const shown = (askedAt: number, at: number) => foresight.shown(askedAt, at);
  frames(20, shown);
  chosen = "off";
  expect(frames(10, shown)).toBe(0);
  chosen = "velocity";
  expect(frames(10, shown)).toBeCloseTo(0.105, 6);
  foresight.reset();
  expect(frames(10, () => undefined)).toBe(0);
});

test("a camera that is put elsewhere, however near, is not on its way there", () => {
  const shown = (askedAt: number, at: number) => foresight.shown(askedAt, at);
  frames(20, shown);
  const [x, y, z] = rig.pose.position;
  rig.drive(() => ({ position: [x + 0.5, y, z], quaternion: [...orientation(10, 0)] }));
  expect(frames(1, shown)).toBe(0);
  rig.drive(null); // back to the user, at the scene's start
  expect(frames(1, shown)).toBe(0);
  turning = 1;
  frames(20, shown);
  turning = 0;
  rig.resetCamera();
  frames(1, shown);
  expect(foresight.pose(now).quaternion).toEqual(rig.pose.quaternion);
  expect(foresight.onScreen(now).quaternion).toEqual(rig.pose.quaternion);
});

test("what takes long at rest, where views are refined, is not what the next movement waits for", () => {
  const shown = (askedAt: number, at: number) => foresight.shown(askedAt, at);
  frames(20, shown);
  const stop = now;
  rig.drive((at) => ({ position: [Math.min(at, stop) / 1000, 0, 0], quaternion: [0, 0, 0, 1] }));
  frames(50, () => undefined);
  frames(30, (_, at) => foresight.shown(at - 150, at + 300));
  rig.drive((at) => ({ position: [(at - 800) / 1000, 0, 0], quaternion: [0, 0, 0, 1] }));
  expect(frames(10, () => undefined)).toBeCloseTo(0.105, 6);
});

describe("a predictor", () => {
  const pose = (azimuth: number, x = 0): ScenePose => ({
    position: [x, 0, 0],
    quaternion: [...orientation(azimuth, 0)],
  });
  const predictorOf = (predict = velocity) => new Predictor(predict, () => 4);

  /** Turns at 60 degrees per second for half a second, and returns the time of the end. */
  function turning(predictor: Predictor, rate = 60): number {
    for (let i = 0; i <= rate / 2; i++) predictor.observe(pose((i * 60) / rate), 1000 + (i * 1000) / rate);
    return 1500;
  }

  test.each([30, 60, 120])("at %d Hz a steady turn goes on", (rate) => {
    const predictor = predictorOf();
    turning(predictor, rate);
    expect(angleBetween(predictor.predict(100).quaternion, pose(36).quaternion)).toBeLessThan(1e-6);
  });

  test("once the camera rests, its very pose is asked for", () => {
    const predictor = predictorOf(() => pose(77));
    const end = turning(predictor);
    expect(predictor.predict(100)).toEqual(pose(77));
    for (let at = end; at <= end + 250; at += 10) predictor.observe(pose(30), at);
    expect(predictor.predict(100)).toEqual(pose(30));
  });

  describe("what was before says nothing", () => {
    test.each([
      ["after a turn that nobody makes", pose(120), 1516],
      ["after a jump", pose(31, 2), 1516],
      ["on a clock that went back", pose(31), 900],
    ])("%s", (_, next, at) => {
      const predictor = predictorOf();
      turning(predictor);
      predictor.observe(next, at);
      expect(predictor.predict(100)).toEqual(next);
    });
  });

  test("a pose that is none is passed over, and none is answered", () => {
    const predictor = predictorOf();
    turning(predictor);
    predictor.observe({ position: [Number.NaN, 0, 0], quaternion: [0, 0, 0, 1] }, 1516);
    expect(predictor.predict(0)).toEqual(pose(30));
    const broken = predictorOf(() => ({ position: [0, 0, 0], quaternion: [0, 0, 0, 0] }));
    turning(broken);
    expect(broken.predict(100)).toEqual(pose(30));
  });

  test("looks at no time but the future", () => {
    const predictor = predictorOf();
    turning(predictor);
    expect([-1, 0, Number.NaN].map((ahead) => predictor.predict(ahead))).toEqual([pose(30), pose(30), pose(30)]);
  });
});

describe("lead time", () => {
  /** Frames on screen at a fixed interval, each with the same delay after its request. */
  function watched(lead: LeadTime, { delay, every, count = 30, from = 1000 }: Record<string, number>): number {
    let at = from as number;
    for (let i = 0; i < (count as number); i++, at += every as number) lead.shown(at - (delay as number), at);
    return at;
  }

  test("is how long a frame takes to the screen, and half of how long it stays there", () => {
    const lead = new LeadTime();
    expect(lead.ahead).toBe(0);
    watched(lead, { delay: 120, every: 20 });
    expect(lead.ahead).toBe(130);
  });

  test("follows the network within a few frames, and not a single one that is late", () => {
    const lead = new LeadTime();
    const at = watched(lead, { delay: 40, every: 10 });
    lead.shown(at - 900, at);
    expect(lead.ahead).toBe(45);
    watched(lead, { delay: 300, every: 10, count: 8, from: at + 300 });
    expect(lead.ahead).toBe(305);
  });

  test("a rest is no long interval between frames", () => {
    const lead = new LeadTime();
    const at = watched(lead, { delay: 50, every: 20 });
    watched(lead, { delay: 50, every: 10_000, count: 20, from: at + 10_000 });
    expect(lead.ahead).toBe(60);
  });

  test("a video that goes on while the camera rests is not late", () => {
    const lead = new LeadTime();
    let at = watched(lead, { delay: 100, every: 20 });
    for (const asked = at - 100; at < 9000; at += 20) lead.shown(asked, at);
    expect(lead.ahead).toBe(110);
  });

  test("looks half a second ahead at most, and nowhere on a new connection", () => {
    const lead = new LeadTime();
    watched(lead, { delay: 4000, every: 200 });
    expect(lead.ahead).toBe(500);
    lead.clear();
    expect(lead.ahead).toBe(0);
  });
});
