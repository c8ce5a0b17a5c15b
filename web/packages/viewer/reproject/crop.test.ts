import { expect, test } from "vitest";
import { cropFor } from "./crop";
import { fakeView, turned } from "./fake-view";
import { resized, type View, viewOfFrame } from "./view";

const VIEW = fakeView();
const FRAME = viewOfFrame(VIEW, { width: 200, height: 110, marginX: 20, marginY: 10 });

test("a view is a frame without its margins", () => {
  expect(cropFor(VIEW, VIEW, 1)).toEqual({ x: 0, y: 0 });
  expect(cropFor(FRAME, VIEW, 1)).toEqual({ x: 20, y: 10 });
});

test.each<[string, View]>([
  ["turned by a tenth of a pixel", { ...VIEW, ...turned(0.06) }],
  ["a tenth of a pixel aside, as the nearest thing sees it", { ...VIEW, position: [0.001, 0, 0] }],
  ["closer", { ...VIEW, position: [0, 0, 0.01] }],
  ["of another lens", { ...VIEW, fx: 101 }],
  ["half a pixel aside", { ...VIEW, cx: 80.5 }],
  ["enlarged", resized(VIEW, 320, 180)],
  ["upside down", { ...VIEW, quaternion: [0, 0, 1, 0] }],
  ["wider than the frame", { ...VIEW, width: 240, cx: 120 }],
])("a view that is %s is not", (_, view) => {
  expect(cropFor(FRAME, view, 1)).toBeNull();
});

test("a pose that was rounded on its way is the same pose", () => {
  const rounded = { ...VIEW, position: [1e-6, 0, 0], quaternion: [0, -1e-6, 0, -1] } as const;
  expect(cropFor(FRAME, rounded, 1)).toEqual({ x: 20, y: 10 });
});

test("where all is infinitely far, a step changes nothing", () => {
  expect(cropFor(FRAME, { ...VIEW, position: [5, 0, 0] }, 0)).toEqual({ x: 20, y: 10 });
});
