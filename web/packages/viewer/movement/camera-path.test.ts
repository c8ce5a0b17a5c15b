import { expect, test } from "vitest";
import { angleBetween, fromRotationVector, subtract } from "../view/vector";
import { cameraPath } from "./camera-path";
import type { TimedPose } from "./movement";

const AHEAD = [0, 0, 0, 1] as const;
const key = (t_ms: number, position: readonly number[], turned = 0): TimedPose => ({
  t_ms,
  position: position as never,
  quaternion: [...fromRotationVector([0, (turned * Math.PI) / 180, 0])],
});
const distance = (a: readonly number[], b: readonly number[]) => Math.hypot(...subtract(a as never, b as never));

/** Keyframes at uneven times. */
const WALK = [key(0, [0, 0, 0]), key(1000, [1, 0, 0], 60), key(1500, [1, 0, 2], 170), key(4000, [-3, 1, 2], 260)];

test("passes every keyframe at its time", () => {
  const path = cameraPath(WALK);
  expect(path.duration).toBe(4000);
  for (const { t_ms, position, quaternion } of WALK) {
    const pose = path.at(t_ms);
    expect(distance(pose.position, position)).toBeLessThan(1e-9);
    expect(angleBetween(pose.quaternion, quaternion)).toBeLessThan(1e-6);
  }
});

test("neither position nor rotation jumps in speed at a keyframe", () => {
  const path = cameraPath(WALK);
  const step = 0.01;
  for (const { t_ms } of WALK.slice(1, -1)) {
    const [before, at, after] = [path.at(t_ms - step), path.at(t_ms), path.at(t_ms + step)];
    const arriving = subtract(at.position, before.position).map((way) => way / step);
    const leaving = subtract(after.position, at.position).map((way) => way / step);
    expect(distance(arriving, leaving)).toBeLessThan(1e-5);
    const turning = [angleBetween(before.quaternion, at.quaternion), angleBetween(at.quaternion, after.quaternion)];
    expect((turning[0] ?? 0) / step).toBeCloseTo((turning[1] ?? 1) / step, 3);
  }
});

test("between two keyframes the camera goes straight and turns evenly, the shorter way", () => {
  const path = cameraPath([key(0, [0, 0, 0]), key(1000, [4, 0, 0], 120)]);
  expect(path.at(250).position).toEqual([1, 0, 0]);
  expect(angleBetween(AHEAD, path.at(250).quaternion)).toBeCloseTo(30);
});

test("the camera rests between equal keyframes", () => {
  const path = cameraPath([key(0, [0, 0, 0]), key(1000, [2, 0, 0]), key(2000, [2, 0, 0]), key(3000, [2, 0, 5])]);
  expect(path.at(1500).position).toEqual([2, 0, 0]);
});

test("a closed path passes its first keyframe at the speed with which it returns", () => {
  const circle = [0, 90, 180, 270, 360].map((angle, i) => {
    const radian = (angle * Math.PI) / 180;
    return key(i * 1000, [Math.sin(radian), 0, Math.cos(radian)], angle);
  });
  const path = cameraPath(circle, { closed: true });
  const leaving = subtract(path.at(1).position, path.at(0).position);
  const arriving = subtract(path.at(4000).position, path.at(3999).position);
  expect(distance(leaving, arriving)).toBeLessThan(1e-5);
  expect(Math.hypot(...path.at(500).position)).toBeGreaterThan(0.85); // a straight line passes at 0.71
});

test("easing changes the speed, not the way", () => {
  const way = [key(0, [0, 0, 0]), key(1000, [1, 0, 0])];
  const at = (easing: never, time: number) => cameraPath(way, { easing }).at(time).position[0];
  expect(["linear", "ease-in", "ease-out", "ease-in-out"].map((name) => at(name as never, 250))).toEqual([
    0.25, 0.0625, 0.4375, 0.15625,
  ]);
  expect(at(((share: number) => share ** 3) as never, 500)).toBe(0.125);
  expect([at("ease-in" as never, -5), at("ease-in" as never, 9999)]).toEqual([0, 1]);
});

test.each([[[]], [[key(0, [0, 0, 0])]], [[key(5, [0, 0, 0]), key(5, [1, 0, 0])]]])("%j is no path", (keyframes) => {
  expect(() => cameraPath(keyframes)).toThrow("keyframes");
});
