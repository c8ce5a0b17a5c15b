import { expect, test } from "vitest";
import { projectToSimplex } from "./simplex";

test.each([
  [
    [0.5, 0.5],
    [0.5, 0.5],
  ],
  [
    [2, 0],
    [1, 0],
  ],
  [
    [1.0625, 0.125],
    [0.96875, 0.03125],
  ],
  [
    [0.2, 0.2, 0.2],
    [1 / 3, 1 / 3, 1 / 3],
  ],
  [
    [-3, 0.1, 0.4],
    [0, 0.35, 0.65],
  ],
  [[-5], [1]],
])("%j becomes %j", (point, expected) => {
  const projected = projectToSimplex(point);
  for (const [i, value] of expected.entries()) expect(projected[i]).toBeCloseTo(value, 12);
});
