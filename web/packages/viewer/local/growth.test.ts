import { expect, test } from "vitest";
import { grown, growthOf, isScale } from "./growth";

const HEADER = ["ply", "comment first 256 growth 1.536", "comment first 1024 growth 1.2", "element vertex 9000"];

test.each([
  [200, 1.536],
  [260, 1.536],
  [1000, 1.2],
  [5000, 1.2],
])("%i Gaussians are drawn %f times larger, as the header says of about as many", (gaussians, growth) => {
  expect(growthOf(HEADER, gaussians)).toBe(growth);
});

test("without a word about it, Gaussians are drawn as they are", () => {
  expect(growthOf(["ply", "comment first light", "comment first 256 growth"], 256)).toBe(1);
});

test("scales are the ends of ranges", () => {
  expect(["min_scale_x", "max_scale_z"].every((name) => isScale("float", name))).toBe(true);
  expect([isScale("uint", "scale_0"), isScale("float", "packed_scale"), isScale("float", "x")]).not.toContain(true);
});

test("only scales change, in a copy", () => {
  const rows = new Uint8Array(new Float32Array([1, -3, 2, -4]).buffer); // x and a scale of two Gaussians
  const before = rows.slice();
  expect([...new Float32Array(grown(rows, 8, [4], Math.E).buffer)]).toEqual([1, -2, 2, -3]);
  expect(rows).toEqual(before);
  expect(grown(rows, 8, [], 2)).toBe(rows);
  expect(grown(rows, 8, [4], 1)).toBe(rows);
});
