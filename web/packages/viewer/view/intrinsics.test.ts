import { describe, expect, test } from "vitest";
import { defaultIntrinsics, viewportFor } from "./intrinsics";

const degrees = (half: number, f: number) => (2 * Math.atan(half / f) * 180) / Math.PI;

describe("the default lens", () => {
  test.each([
    [1280, 720],
    [1000, 1000],
    [3440, 1440],
  ])("sees 60° from top to bottom of %i × %i", (width, height) => {
    const { fx, fy, cx, cy } = defaultIntrinsics({ width, height });
    expect(degrees(height / 2, fy)).toBeCloseTo(60, 1);
    expect(fx).toBe(fy);
    expect([cx, cy]).toEqual([width / 2, height / 2]);
  });

  test("sees at least 50° from side to side on an upright phone", () => {
    const { fx } = defaultIntrinsics({ width: 390, height: 844 });
    expect(degrees(195, fx)).toBeCloseTo(50, 1);
  });
});

describe("the viewport", () => {
  test("is the stage's own size in whole pixels", () => {
    expect(viewportFor(968.4, 800.9)).toEqual({ width: 968, height: 800 });
  });

  test.each([
    [10_000, 2000],
    [500, 20_000],
    [8000, 8000],
  ])("keeps its shape within the server's limits: %i × %i", (width, height) => {
    const viewport = viewportFor(width, height);
    expect(Math.max(viewport.width, viewport.height)).toBeLessThanOrEqual(8192);
    expect(viewport.width * viewport.height).toBeLessThanOrEqual(16_777_216);
    expect(viewport.width / viewport.height).toBeCloseTo(width / height, 1);
  });
});
