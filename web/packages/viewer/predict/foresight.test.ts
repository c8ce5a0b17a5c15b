import { beforeEach, expect, test } from "vitest";
import type { SceneInfo } from "#client/wire/render";
import { orientation } from "../view/camera";
import { NO_INPUT } from "../view/motion";
import { Rig } from "../view/rig";
import { Foresight } from "./foresight";
import type { PredictorName } from "./registry";

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
  rig = new Rig({
    sampleInput: () => ({ ...NO_INPUT, axes: { ...NO_INPUT.axes, turnRight: turning } }),
    turnSpeed: () => 60,
  });
  rig.enter(SCENE);
  rig.drive((at) => ({ position: [at / 1000, 0, 0], quaternion: [0, 0, 0, 1] }));
  foresight = new Foresight(rig, () => chosen);
});

/** Animation frames every 10 ms, each with a frame that was asked for 100 ms before; how far ahead the last one looks (m). */
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
  expect(foresight.onScreen(now + 10)).toBe(rig.pose); // nothing was asked for in that animation frame
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
