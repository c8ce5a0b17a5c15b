import { expect, test } from "vitest";
import { Glide } from "./glide";

test("all that was asked is given out, a part at a time, and then nothing", () => {
  const glide = new Glide(() => true);
  glide.add(0.2);
  const parts = Array.from({ length: 60 }, () => glide.take(16));
  expect(parts[0]).toBeGreaterThan(0.02);
  expect(parts[0]).toBeLessThan(0.1);
  expect(parts.reduce((sum, part) => sum + part, 0)).toBeCloseTo(0.2, 9);
  expect(parts.at(-1)).toBe(0);
});

test("whoever wants no motion gets all of it at once", () => {
  const glide = new Glide(() => false);
  glide.add(-0.4);
  expect(glide.take(16)).toBe(-0.4);
  expect(glide.take(16)).toBe(0);
});

test("stopping forgets what is left", () => {
  const glide = new Glide(() => true);
  glide.add(1);
  glide.stop();
  expect(glide.take(16)).toBe(0);
});
