import { expect, test } from "vitest";
import type { View } from "../reproject/view";
import { widened } from "./wider";

const VIEW: View = {
  position: [1, 2, 3],
  quaternion: [0, 0, 0, 1],
  fx: 300,
  fy: 310,
  cx: 320,
  cy: 170,
  width: 640,
  height: 360,
};

test("what is in the middle stays as it was, with margins around it", () => {
  expect(widened(VIEW, 0.1)).toEqual({ ...VIEW, cx: 384, cy: 206, width: 768, height: 432 });
  expect(widened(VIEW, 0)).toEqual(VIEW);
});

test("a viewport that the server would refuse is sampled less finely, with the same field of view", () => {
  const { width, height, fx, fy, cx, cy } = widened({ ...VIEW, width: 8192, height: 2048, cx: 4096, cy: 1024 }, 0.1);
  expect(width).toBeLessThanOrEqual(8192);
  expect(height).toBeLessThanOrEqual(2048);
  expect(cx).toBeCloseTo(width / 2);
  expect(cy).toBeCloseTo(height / 2);
  expect(width / fx).toBeCloseTo((8192 + 2 * 819) / 300);
  expect(height / fy).toBeCloseTo((2048 + 2 * 205) / 310);
});
