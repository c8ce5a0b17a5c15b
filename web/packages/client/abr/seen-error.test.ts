import { describe, expect, test } from "vitest";
import type { Rung } from "../wire/render";
import { WAYS } from "./controller";
import { PAPER_LADDER } from "./ladder";
import { decibels, seenLate, seenOfRung, together } from "./seen-error";

describe("a late picture", () => {
  test.each(WAYS)("shown %s is never better the further its view has turned", (way) => {
    expect(seenLate(way, 0)).toEqual({ mse: 0, ssim: 1 });
    for (let degrees = 0; degrees < 100; degrees++) {
      const [less, more] = [seenLate(way, degrees), seenLate(way, degrees + 1)];
      expect(more.mse).toBeGreaterThanOrEqual(less.mse);
      expect(more.ssim).toBeLessThanOrEqual(less.ssim);
    }
  });

  test("is worst as it came, and best if its pose was predicted", () => {
    const mean = (way: (typeof WAYS)[number]) =>
      [1, 2, 4, 8].reduce((sum, degrees) => sum + seenLate(way, degrees).ssim, 0);
    expect(mean("stale")).toBeLessThan(mean("rotation"));
    expect(mean("rotation")).toBeLessThan(mean("depth"));
    expect(mean("depth")).toBeLessThanOrEqual(mean("predicted"));
  });
});

describe("a rung's picture", () => {
  test("is as the ladder says", () => {
    const rung = { psnr_db: 33.3, expected_kb: 1 };
    expect(decibels(seenOfRung(rung).mse)).toBeCloseTo(33.3, 9);
    expect(seenOfRung({ ...rung, psnr_db: 35 }).ssim).toBeGreaterThan(seenOfRung(rung).ssim);
  });

  test("is better the larger it is, where the ladder says nothing", () => {
    const ssims = PAPER_LADDER.map((rung) => seenOfRung(rung).ssim);
    expect(ssims).toEqual(ssims.toSorted((a, b) => b - a));
    expect(ssims[0]).toBeLessThan(1);
  });
});

test("two faults are worse than either", () => {
  const rung = seenOfRung(PAPER_LADDER[2] as Rung);
  const late = seenLate("depth", 3);
  const both = together(rung, late);
  expect(both.mse).toBeCloseTo(rung.mse + late.mse, 9);
  expect(both.ssim).toBeLessThan(Math.min(rung.ssim, late.ssim));
});
