import { expect, test } from "vitest";
import type { Prefix } from "./ply";
import { nextStep } from "./steps";

const OF_1000 = { gaussians: 1000, lines: [] };
const OF_600 = { gaussians: 600, lines: [] };

test("a scene is built anew at 2, 5, 10, 25, 50 and 100 % of its Gaussians, and no oftener", () => {
  const drawn: (Prefix | null)[] = [null];
  for (let there = 0; there <= 1000; there++) {
    const step = nextStep(OF_1000, { gaussians: there, whole: there === 1000 }, drawn.at(-1) ?? null);
    if (step) drawn.push(step);
  }
  expect(drawn.slice(1).map((step) => step?.gaussians)).toEqual([20, 50, 100, 250, 500, 1000]);
  expect(drawn.at(-1)?.whole).toBe(true);
});

test("what came at once is drawn at once: steps in between are left out", () => {
  expect(nextStep(OF_1000, { gaussians: 612, whole: false }, { gaussians: 20, whole: false })?.gaussians).toBe(500);
  expect(nextStep(OF_1000, { gaussians: 1000, whole: true }, null)).toEqual({ gaussians: 1000, whole: true });
});

test("all Gaussians without their spherical harmonics are not the last step", () => {
  const bare = nextStep(OF_600, { gaussians: 600, whole: false }, { gaussians: 300, whole: false });
  expect(bare).toEqual({ gaussians: 600, whole: false });
  expect(nextStep(OF_600, { gaussians: 600, whole: false }, bare)).toBeNull();
  expect(nextStep(OF_600, { gaussians: 600, whole: true }, bare)).toEqual({ gaussians: 600, whole: true });
});

test("a file that says which parts of it are pictures is drawn at these", () => {
  const header = { gaussians: 1000, lines: ["comment first 256 growth 2.0", "comment first 512 growth 1.5"] };
  expect(nextStep(header, { gaussians: 255, whole: false }, null)).toBeNull();
  expect(nextStep(header, { gaussians: 511, whole: false }, null)?.gaussians).toBe(256);
  expect(nextStep(header, { gaussians: 999, whole: false }, { gaussians: 256, whole: false })?.gaussians).toBe(512);
});
