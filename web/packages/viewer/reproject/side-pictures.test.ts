import { expect, test } from "vitest";
import { fakeView } from "#fakes/views";
import { rotate, type Vector3 } from "../view/vector";
import { SIDES, sideView } from "./side-pictures";
import { transfer, transferred } from "./view";

const UP: Vector3 = [0, 0.6, 0.8];

test("whichever way one looks, some side shows it", () => {
  const sides = SIDES.map((side) => sideView(side, [1, 2, 3], UP));
  for (let i = 0; i < 500; i++) {
    const z = 1 - (2 * (i + 0.5)) / 500; // a Fibonacci lattice on the sphere
    const around = i * Math.PI * (3 - Math.sqrt(5));
    const flat = Math.sqrt(1 - z * z);
    const direction: Vector3 = [flat * Math.cos(around), flat * Math.sin(around), z];
    const seenBy = sides.filter((side) => {
      const eye = fakeView({ position: [1, 2, 3], quaternion: towards(direction) });
      const pixel = transferred(transfer(eye, side), eye.cx, eye.cy, 0);
      return pixel?.every((value) => value >= 0 && value <= side.width) ?? false;
    });
    expect(seenBy.length).toBeGreaterThan(0);
  }
});

test("four sides are level with the scene's floor", () => {
  const ahead = SIDES.map((side) => rotate(sideView(side, [0, 0, 0], UP).quaternion, [0, 0, 1]));
  const upwards = ahead.map(([x, y, z]) => Math.round(1e6 * (x * UP[0] + y * UP[1] + z * UP[2])) / 1e6 + 0);
  expect(upwards).toEqual([0, 0, 0, 0, 1, -1]);
});

test("no two sides are seen through the same lens, so that the server drops neither of two that are under way", () => {
  const lenses = SIDES.map((side) => sideView(side, [0, 0, 0], UP)).map(({ width, fx }) => `${width} ${fx}`);
  expect(new Set(lenses).size).toBe(SIDES.length);
});

/** The rotation of a camera that looks along a direction of length 1. */
function towards([x, y, z]: Vector3): [number, number, number, number] {
  const length = Math.hypot(y, x, 1 + z) || 1;
  return z < -0.999999 ? [1, 0, 0, 0] : [-y / length, x / length, 0, (1 + z) / length];
}
