import { expect, test } from "vitest";
import { rungsFor } from "./rungs";

const LADDER = [
  { width: 1280, height: 720 },
  { width: 640, height: 360 },
  { width: 320, height: 180 },
];

test("a stream offers no more pixels than are shown, and always something", () => {
  expect(rungsFor(LADDER, { width: 1920, height: 1080 })).toEqual([0, 1, 2]);
  expect(rungsFor(LADDER, { width: 1000, height: 600 })).toEqual([1, 2]);
  expect(rungsFor(LADDER, { width: 100, height: 100 })).toEqual([2]);
});
