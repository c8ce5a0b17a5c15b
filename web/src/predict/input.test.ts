import { beforeEach, expect, test } from "vitest";
import { type InputSample, NO_INPUT, NO_NUDGE } from "../view/motion";
import { Rig } from "../view/rig";
import { angleBetween, subtract } from "../view/vector";
import type { SceneInfo } from "../wire/render";
import { Auto } from "./auto";
import { Input } from "./input";
import type { Predictor } from "./predictor";

const SCENE = { up: [0, -1, 0], camera: { position: [0, -2, -8], look_at: [0, -2, 0] } } as SceneInfo;
const HELD = { ...NO_INPUT, axes: { ...NO_INPUT.axes, forward: 1, turnRight: -1 } };

let input: InputSample;
let rig: Rig;
let now: number;

beforeEach(() => {
  input = NO_INPUT;
  now = 1000;
  rig = new Rig({ sampleInput: () => input, turnSpeed: () => 60 });
  rig.enter(SCENE);
});

/** Animation frames at 60 Hz. */
function frames(predictor: Predictor, count: number): void {
  for (let i = 0; i < count; i++) {
    now += 1000 / 60;
    rig.sample(now);
    predictor.observe(rig.pose, now);
  }
}

test.each([Input, Auto])("%o is exact as long as keys stay as they are, from the first frame on", (Kind) => {
  const predictor = new Kind({ rig });
  frames(predictor, 3);
  input = HELD;
  frames(predictor, 1);
  const foreseen = predictor.predict(300);
  frames(predictor, 18);
  expect(angleBetween(foreseen.quaternion, rig.pose.quaternion)).toBeLessThan(1e-3);
  expect(Math.hypot(...subtract(foreseen.position, rig.pose.position))).toBeLessThan(0.002);
  input = NO_INPUT;
  frames(predictor, 1);
  expect(predictor.predict(300)).toEqual(rig.pose);
});

test("looking ahead moves nothing", () => {
  input = HELD;
  const predictor = new Input({ rig });
  frames(predictor, 5);
  const before = rig.pose;
  predictor.predict(500);
  expect(rig.pose).toBe(before);
  input = NO_INPUT;
  frames(predictor, 1);
  expect(rig.pose).toBe(before);
});

test("a drag goes on a little and slows down, and is over when the pointer stops", () => {
  const predictor = new Input({ rig });
  input = { ...NO_INPUT, nudge: { ...NO_NUDGE, turnRight: 1 } };
  frames(predictor, 5);
  const far = (ahead: number) => angleBetween(predictor.predict(ahead).quaternion, rig.pose.quaternion);
  expect(far(10)).toBeCloseTo(0.6, 1);
  expect(far(500)).toBeGreaterThan(8);
  expect(far(500)).toBeLessThan(12);
  input = NO_INPUT;
  frames(predictor, 3);
  expect(predictor.predict(100)).toEqual(rig.pose);
});

test("while a source drives the camera the person's keys say nothing", () => {
  const predictor = new Input({ rig });
  rig.drive((at) => ({ position: [at / 1000, 0, 0], quaternion: [0, 0, 0, 1] }));
  input = HELD;
  frames(predictor, 5);
  expect(predictor.predict(100)).toEqual(rig.pose);
});

test("automatic goes on as a source does, and as the person does once that has ended", () => {
  const predictor = new Auto({ rig });
  rig.drive((at) => (at > 1500 ? null : { position: [at / 1000, 0, 0], quaternion: [0, 0, 0, 1] }));
  frames(predictor, 25);
  expect(predictor.predict(100).position[0]).toBeCloseTo(now / 1000 + 0.1, 1);
  frames(predictor, 10);
  expect(predictor.predict(100)).toEqual(rig.pose);
});
