import { expect, test } from "vitest";
import { poseAt, type TimedPose } from "./playback";

const HALF = Math.SQRT1_2;
const at = (t_ms: number, x: number, quaternion: TimedPose["quaternion"] = [0, 0, 0, 1]): TimedPose => ({
  t_ms,
  position: [x, 0, 0],
  quaternion,
});

test.each([
  [-5, 1],
  [0, 1],
  [50, 2],
  [100, 3],
  [250, 4.5],
  [400, 6],
  [9999, 6],
])("at %d ms the position is %d", (t, x) => {
  expect(poseAt([at(0, 1), at(100, 3), at(400, 6)], t).position[0]).toBeCloseTo(x);
});

test("turns at an even pace", () => {
  const { quaternion } = poseAt([at(0, 0), at(100, 0, [0, HALF, 0, HALF])], 100 / 3);
  const degrees = (2 * Math.atan2(quaternion[1], quaternion[3]) * 180) / Math.PI;
  expect(degrees).toBeCloseTo(30);
});

test("takes the shorter way between a rotation and its negative twin", () => {
  const { quaternion } = poseAt([at(0, 0), at(100, 0, [0, -HALF, 0, -HALF])], 50);
  const degrees = (2 * Math.atan2(quaternion[1], quaternion[3]) * 180) / Math.PI;
  expect(degrees).toBeCloseTo(45);
});

test("rotations stay of length one, equal ones too, and points may share a time", () => {
  const points = [at(0, 0), at(0, 1), at(100, 1)];
  expect(Math.hypot(...poseAt(points, 50).quaternion)).toBeCloseTo(1);
  expect(poseAt(points, 0).position[0]).toBe(1);
});
