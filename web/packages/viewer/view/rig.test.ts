import { beforeEach, expect, test } from "vitest";
import { STILL, steeredRig } from "#fakes/rig";
import { COURTYARD } from "#fakes/server";
import type { ScenePose } from "./camera";
import type { Rig } from "./rig";
import { rotate } from "./vector";

let axes: typeof STILL;
let rig: Rig;

beforeEach(() => {
  axes = STILL;
  rig = steeredRig(() => axes);
  rig.sample(0);
});

test("a pose gets a new number with each change, and only then", () => {
  const { seq } = rig.pose;
  expect(rig.sample(16)).toBe(false);
  expect(rig.pose.seq).toBe(seq);
  axes = { ...STILL, forward: 1 };
  expect(rig.sample(32)).toBe(true);
  expect(rig.pose.seq).toBe(seq + 1);
  expect(rig.changedAt).toBe(32);
});

test("stays where it is when the scene is known better, also with another axis up", () => {
  const { position, quaternion } = rig.pose;
  rig.update({ ...COURTYARD, up: [1, 0, 0], camera: { position: [5, 5, 5], look_at: [0, 0, 0] } });
  rig.sample(16);
  expect(rig.pose.position).toEqual(position.map((value) => expect.closeTo(value)));
  const forward = rotate(rig.pose.quaternion, [0, 0, 1]);
  expect(forward).toEqual(rotate(quaternion, [0, 0, 1]).map((value) => expect.closeTo(value)));
  rig.resetCamera();
  expect(rig.pose.position).toEqual([5, 5, 5].map((value) => expect.closeTo(value)));
});

test("a source drives it until the source ends, and then the person's camera is back where it was", () => {
  const before = rig.pose;
  const path: ScenePose[] = [
    { position: [1, 0, 0], quaternion: [0, 0, 0, 1] },
    { position: [2, 0, 0], quaternion: [0, 0, 0, 1] },
  ];
  rig.drive(() => path.shift() ?? null);
  axes = { ...STILL, forward: 1 };
  rig.sample(16);
  expect(rig.pose.position).toEqual([1, 0, 0]);
  rig.sample(32);
  axes = STILL;
  rig.sample(48);
  expect(rig.pose).toEqual({ ...before, seq: before.seq + 3 });
});

test("taking over continues from where a source has brought the camera", () => {
  rig.drive(() => ({ position: [1, 0, 0], quaternion: [0, Math.SQRT1_2, 0, Math.SQRT1_2] }));
  axes = { ...STILL, forward: 1 };
  rig.sample(16);
  expect(rig.source.value).not.toBeNull();
  rig.takeOver();
  expect(rig.source.value).toBeNull();
  rig.sample(32);
  const [x, y, z] = rig.pose.position;
  expect(x).toBeGreaterThan(1);
  expect([y, z]).toEqual([0, expect.closeTo(0, 5)]);
});

test("a source that yields ends with input that moves the camera, which goes on from there", () => {
  rig.drive(() => ({ position: [1, 0, 0], quaternion: [0, 0, 0, 1] }), { yields: true });
  rig.sample(16);
  rig.sample(32);
  expect(rig.source.value).not.toBeNull();
  axes = { ...STILL, forward: 1 };
  rig.sample(48);
  expect(rig.source.value).toBeNull();
  expect(rig.pose.position[0]).toBeCloseTo(1);
  expect(rig.pose.position[2]).toBeGreaterThan(0);
});

test("a stage that keeps its size keeps its viewport", () => {
  rig.resize(640, 360);
  const before = rig.viewport.value;
  rig.resize(640.2, 360);
  expect(rig.viewport.value).toBe(before);
});

test("the start view waits while a source has the camera", () => {
  axes = { ...STILL, forward: 1 };
  rig.sample(16);
  axes = STILL;
  let ended = false;
  rig.drive(() => (ended ? null : { position: [1, 0, 0], quaternion: [0, 0, 0, 1] }));
  rig.sample(32);
  const { seq } = rig.pose;
  rig.resetCamera();
  expect(rig.sample(48)).toBe(false);
  expect(rig.pose).toMatchObject({ seq, position: [1, 0, 0] });
  ended = true;
  rig.sample(64);
  expect(rig.pose.position).toEqual([0, -2, -8]);
});

test("listeners receive every sample, whether the camera moved or not", () => {
  const heard: number[] = [];
  const stop = rig.onSample(({ position }, at) => heard.push(at, position[2]));
  rig.sample(16);
  axes = { ...STILL, forward: 1 };
  rig.sample(32);
  stop();
  rig.sample(48);
  expect(heard).toEqual([16, -8, 32, expect.any(Number)]);
  expect(heard[3]).toBeGreaterThan(-8);
});

test("it says how fast the camera turns", () => {
  axes = { ...STILL, turnRight: 1 };
  rig.sample(20);
  expect(rig.turning).toBeCloseTo(60, 0);
  axes = STILL;
  rig.sample(40);
  expect(rig.turning).toBe(0);
});

test("a focused point is flown to, unless the person moves; drags then orbit it", () => {
  rig.focus([2, -2, 0], true);
  rig.sample(16);
  expect(rig.pose.position).toEqual([0, -2, -8]);
  rig.sample(266);
  expect(rig.pose.position).toEqual([0.5, -2, -6]);
  rig.sample(600);
  expect(rig.pose.position).toEqual([1, -2, -4]);
  rig.focus([2, -2, 0], true);
  rig.sample(616);
  axes = { ...STILL, up: 1 };
  rig.sample(632);
  axes = STILL;
  const { position } = rig.pose;
  rig.sample(2000);
  expect(rig.pose.position, "the person knows better").toEqual(position);
});

test("with reduced motion the camera arrives at once", () => {
  rig.focus([2, -2, 0], false);
  rig.sample(16);
  expect(rig.pose.position).toEqual([1, -2, -4]);
});

test("the camera can be put somewhere, which is no movement", () => {
  const { placements } = rig;
  rig.place({ position: [1, 2, 3], quaternion: [0, Math.SQRT1_2, 0, Math.SQRT1_2] });
  expect(rig.pose.position).toEqual([1, 2, 3]);
  rig.sample(16);
  expect(rig.pose.position).toEqual([1, 2, 3]);
  expect(rig.placements).toBe(placements + 1);
});
