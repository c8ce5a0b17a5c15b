import { beforeEach, expect, test } from "vitest";
import type { ScenePose } from "../camera/camera";
import { NO_NUDGE } from "../input/motion";
import type { SceneInfo } from "../wire";
import { Rig } from "./rig";

const SCENE = { up: [0, -1, 0], camera: { position: [0, -2, -8], look_at: [0, -2, 0] } } as SceneInfo;
const STILL = { forward: 0, right: 0, up: 0, turnRight: 0, turnUp: 0 };

let axes: typeof STILL;
let rig: Rig;

beforeEach(() => {
  axes = STILL;
  rig = new Rig({ sampleInput: () => ({ axes, nudge: NO_NUDGE }), turnSpeed: () => 60 });
  rig.enter(SCENE);
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

test("it says how fast the camera turns", () => {
  axes = { ...STILL, turnRight: 1 };
  rig.sample(20);
  expect(rig.turning).toBeCloseTo(60, 0);
  axes = STILL;
  rig.sample(40);
  expect(rig.turning).toBe(0);
});
