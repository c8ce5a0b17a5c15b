import { expect, test } from "vitest";
import { orientation, type ScenePose } from "./camera";
import { isCut } from "./cut";

const pose = (x: number, azimuth: number): ScenePose => ({
  position: [x, 0, 0],
  quaternion: [...orientation(azimuth, 0)],
});

test.each([
  ["a quick turn", pose(0, 25), false],
  ["a turn that nobody makes", pose(0, 35), true],
  ["a stride", pose(0.5, 0), false],
  ["a jump", pose(1.6, 0), true],
])("%s", (_, after, cut) => {
  expect(isCut(pose(0, 0), after, 5)).toBe(cut);
});

test("a rotation's negative twin is no turn", () => {
  expect(isCut(pose(0, 0), { position: [0, 0, 0], quaternion: [0, 0, 0, -1] }, 5)).toBe(false);
});
