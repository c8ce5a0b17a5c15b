import { expect, test } from "vitest";
import { BEST_PSNR, psnr } from "./ground-truth";

const filled = (...rgba: number[]) => Uint8ClampedArray.from([...rgba, ...rgba]);

test("a difference of 16 in one of three colours is 28.8 dB", () => {
  expect(psnr(filled(100, 50, 0, 255), filled(116, 50, 0, 255))).toBeCloseTo(10 * Math.log10((255 ** 2 * 3) / 256), 9);
});

test("equal pictures have the best, and opacity does not count", () => {
  expect(psnr(filled(1, 2, 3, 255), filled(1, 2, 3, 0))).toBe(BEST_PSNR);
});

test("black against white is 0 dB", () => {
  expect(psnr(filled(0, 0, 0, 255), filled(255, 255, 255, 255))).toBeCloseTo(0, 9);
});
