import { describe, expect, test } from "vitest";
import type { Rung } from "../wire/render";
import { seenOfRung } from "./seen-error";
import { stepOfRung, videoLadder } from "./video-ladder";

const rung = (width: number, height: number, quality = 50): Rung => ({
  name: `${width}×${height}`,
  width,
  height,
  quality,
  expected_kb: (width * height) / 4000,
});
const PAPER = [rung(1280, 720, 90), rung(960, 540, 65), rung(640, 360, 35), rung(320, 180, 10)];

describe("the ladder of video", () => {
  test("has every size, from more bytes to fewer, and never more pixels further down", () => {
    const steps = videoLadder(PAPER);
    expect([...new Set(steps.map((step) => step.rung))]).toEqual([0, 1, 2, 3]);
    for (const [i, step] of steps.slice(1).entries()) {
      expect(step.video.bitrate_kbps).toBeLessThan(steps[i]?.video.bitrate_kbps ?? 0);
      expect(step.rung).toBeGreaterThanOrEqual(steps[i]?.rung ?? 0);
    }
  });

  test("has enough bits for the pixels of each size, and evenly spaced rates", () => {
    for (const ladder of [PAPER, Array.from({ length: 9 }, (_, i) => rung(1280 - 120 * i, 720 - 68 * i))]) {
      const steps = videoLadder(ladder);
      for (const [i, { width, height, expected_kb }] of steps.entries()) {
        expect((expected_kb * 8000) / (width * height)).toBeGreaterThan(0.039);
        if (i > 0) expect(expected_kb / (steps[i - 1]?.expected_kb ?? 0)).toBeCloseTo(0.7, 1);
      }
    }
  });

  test("of the sizes that are offered gives the largest as many bits a pixel as it is worth, with the rungs of the whole", () => {
    const steps = videoLadder(PAPER, 2);
    expect(steps[0]).toMatchObject({ rung: 2, width: 640 });
    expect((steps[0]?.expected_kb ?? 0) * 8000).toBeCloseTo(0.16 * 640 * 360, -3);
  });

  test("expects of a frame its share of the bit rate", () => {
    for (const { expected_kb, video } of videoLadder(PAPER)) {
      expect((expected_kb * 8 * video.frames_per_s) / video.bitrate_kbps).toBeCloseTo(1);
    }
  });

  test("expects a better picture of more bytes, and that of a far larger JPEG", () => {
    const steps = videoLadder(PAPER);
    const errors = steps.map((step) => seenOfRung(step).mse);
    expect(errors).toEqual(errors.toSorted((a, b) => a - b));
    for (const step of steps) {
      expect(seenOfRung(step).mse).toBeLessThan(seenOfRung({ expected_kb: 3 * step.expected_kb }).mse);
    }
  });

  test("has a size once, however many qualities of it the server offers", () => {
    const several = videoLadder([rung(640, 360, 90), rung(640, 360, 60), rung(640, 360, 30)]);
    expect(several).toEqual(videoLadder([rung(640, 360, 90)]));
  });

  test("asks for no less than the least bit rate that there is, and has no steps of no rungs", () => {
    expect(videoLadder([rung(16, 16)]).map(({ video }) => video.bitrate_kbps)).toEqual([10]);
    expect(videoLadder([])).toEqual([]);
  });

  test("has for a rung that a person chose the best step of its size", () => {
    const steps = videoLadder(PAPER);
    const chosen = PAPER.map((one) => steps[stepOfRung(steps, one)]);
    expect(chosen.map((step) => step?.width)).toEqual([1280, 960, 640, 320]);
    expect(steps[stepOfRung(steps, rung(64, 36))]).toBe(steps.at(-1));
  });
});
