import { describe, expect, test } from "vitest";
import courtyard from "../../../../services/render/tigas_render/scenes/demo/ladder.json";
import type { Rung } from "../wire/render";
import { WAYS } from "./controller";
import { PAPER_LADDER } from "./ladder";
import { decibels, seenLate, seenOfRung, together } from "./seen-error";

const LADDER = courtyard.rungs as Rung[];

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

describe("two faults", () => {
  test("are worse than either, but the greater one hides the lesser", () => {
    const blurred = seenOfRung(LADDER.at(-1) as Rung);
    const late = seenLate("stale", 10);
    const both = together(blurred, late);
    expect(both.mse).toBeGreaterThan(late.mse);
    expect(both.mse).toBeLessThan(1.05 * late.mse);
    expect(both.ssim).toBeLessThan(late.ssim);
    expect(1 - both.ssim).toBeLessThan(1.1 * (1 - late.ssim));
  });

  test("leave a picture that is in place as sharp as its rung", () => {
    const blurred = seenOfRung(LADDER.at(-1) as Rung);
    const both = together(blurred, seenLate("predicted", 0.5));
    expect(decibels(both.mse)).toBeCloseTo(decibels(blurred.mse), 1);
    expect(both.ssim).toBeCloseTo(blurred.ssim, 2);
  });
});
