import { expect, test } from "vitest";
import { fileBytes, memoryFor, roomProblem } from "./room";

const GARDEN = { gaussians: 5_800_000, shDegree: 3, bytes: 1_440_000_000 };

test("the file, its numbers and what is drawn take memory together", () => {
  expect(memoryFor({ gaussians: 1000, shDegree: 3, bytes: 248_000 })).toBe(248_000 + 1000 * (4 * 59 + 76 + 64));
  expect(memoryFor({ gaussians: 1000, shDegree: 0, bytes: 56_000 })).toBe(56_000 + 1000 * (4 * 14 + 76));
});

test.each([
  [8, true],
  [4, false],
  [undefined, false],
])("a scene of 3.6 GB in a machine of %s GB: %s", (memory, fits) => {
  const problem = roomProblem(GARDEN, memory);
  expect(problem === null).toBe(fits);
  if (problem !== null) expect(problem).toMatch(/^This scene is too large for this browser: .* 3\.6 GB .* 2\.0 GB /);
});

test.each([
  [0, 16],
  [3, 61],
])("a file of SH degree %i has %i bytes a Gaussian", (degree, bytes) => {
  expect(fileBytes(1000, degree)).toBe(1000 * bytes);
});
