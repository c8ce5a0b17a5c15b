import { expect, test } from "vitest";
import { angleBetween, conjugate, multiply, rotate, rotationBetween, type Vector3 } from "./vector";

const pairs: [Vector3, Vector3][] = [
  [
    [0, -1, 0],
    [0, 0, 1],
  ],
  [
    [0, -1, 0],
    [1, 2, 3],
  ],
  [
    [0, -1, 0],
    [0, -5, 0],
  ],
  [
    [0, -1, 0],
    [0, 1, 0],
  ],
  [
    [0, -1, 0],
    [1e-7, 1, 0],
  ],
];

test.each(pairs)("the rotation from %j to %j brings one onto the other", (from, to) => {
  const turned = rotate(rotationBetween(from, to), from);
  const length = Math.hypot(...to);
  for (const [i, value] of to.entries()) expect(turned[i]).toBeCloseTo(value / length, 5);
});

test("a direction of length zero turns nothing", () => {
  expect(rotationBetween([0, -1, 0], [0, 0, 0])).toEqual([0, 0, 0, 1]);
});

test("a rotation and its conjugate undo each other", () => {
  const q = rotationBetween([0, -1, 0], [3, 1, 2]);
  const [x, y, z] = rotate(multiply(q, conjugate(q)), [1, 2, 3]);
  expect([x, y, z].map((value) => Math.round(value * 1e9) / 1e9)).toEqual([1, 2, 3]);
});

test("the angle between two orientations, whichever of its two quaternions stands for each", () => {
  const quarter = [0, Math.SQRT1_2, 0, Math.SQRT1_2] as const;
  expect(angleBetween([0, 0, 0, 1], quarter)).toBeCloseTo(90);
  expect(angleBetween([0, 0, 0, -1], quarter)).toBeCloseTo(90);
  expect(angleBetween(quarter, quarter)).toBeCloseTo(0);
});
