import { describe, expect, test } from "vitest";
import { ageError, decibels, rungError, WAYS } from "./view-error";

describe("the error of age", () => {
  test.each([
    ["stale", 2.2, 17.7],
    ["stale", 13.2, 13.3],
    ["rotation", 2.2, 32.2],
    ["rotation", 13.2, 20.1],
    ["depth", 2.2, 38.5],
    ["depth", 4.4, 34.1],
    ["depth", 13.2, 25.4],
    ["predicted", 4.4, 39.5],
    ["predicted", 13.2, 27.9],
  ] as const)("%s after %f degrees is what was measured: %f dB", (way, degrees, expected) => {
    expect(Math.abs(decibels(ageError(way, degrees)) - expected)).toBeLessThan(0.8);
  });

  test("never falls with the turn, is nothing without one, and has an end", () => {
    for (const way of WAYS) {
      expect(ageError(way, 0)).toBe(0);
      for (let degrees = 0; degrees < 200; degrees++) {
        expect(ageError(way, degrees + 1)).toBeGreaterThanOrEqual(ageError(way, degrees));
      }
      expect(decibels(ageError(way, 180))).toBeGreaterThan(11);
    }
  });
});

describe("the error of a rung", () => {
  test("is what the ladder says", () => {
    expect(decibels(rungError({ psnr_db: 33.3, expected_kb: 10 }))).toBeCloseTo(33.3, 9);
  });

  test("follows from its bytes where the ladder does not say: a doubling is worth the same everywhere", () => {
    const at = (expected_kb: number) => decibels(rungError({ expected_kb, psnr_db: null }));
    expect(at(20) - at(10)).toBeCloseTo(at(200) - at(100), 9);
    expect(at(200)).toBeGreaterThan(at(100));
  });
});
