import { expect, test } from "vitest";
import { fakeView } from "./fake-view";
import { resized, viewOfFrame } from "./view";

test("a picture of another size has the same field of view", () => {
  expect(resized(fakeView(), 320, 45)).toEqual(
    fakeView({ fx: 200, fy: 50, cx: 160, cy: 22.5, width: 320, height: 45 }),
  );
});

test("a frame's margins widen its view at the same pixels per angle", () => {
  const frame = viewOfFrame(fakeView(), { width: 320 + 64, height: 180 + 36, marginX: 32, marginY: 18 });
  expect(frame).toEqual(fakeView({ fx: 200, fy: 200, cx: 192, cy: 108, width: 384, height: 216 }));
});
