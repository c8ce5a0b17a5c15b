import { describe, expect, test } from "vitest";
import { STILL } from "#fakes/rig";
import { NO_NUDGE, step, suggestedSpeed } from "./motion";

const CAMERA = { position: [0, 0, 0], azimuth: 0, elevation: 0 } as const;
const SPEEDS = { turn: 60, move: 2 };

test("when nothing is asked the camera is the very same", () => {
  expect(step(CAMERA, STILL, NO_NUDGE, SPEEDS, 16)).toBe(CAMERA);
});

test("a second of walking goes as far whatever the frame rate", () => {
  for (const frames of [15, 60, 144]) {
    let camera: ReturnType<typeof step> = CAMERA;
    for (let i = 0; i < frames; i++) camera = step(camera, { ...STILL, forward: 1 }, NO_NUDGE, SPEEDS, 1000 / frames);
    expect(camera.position[2]).toBeCloseTo(2, 6);
  }
});

test("turning follows its speed", () => {
  const camera = step(CAMERA, { ...STILL, turnRight: -1, turnUp: 1 }, NO_NUDGE, SPEEDS, 50);
  expect(camera.azimuth).toBeCloseTo(-3, 9);
  expect(camera.elevation).toBeCloseTo(3, 9);
});

test("walking diagonally is not faster", () => {
  const { position } = step(CAMERA, { ...STILL, forward: 1, right: 1 }, NO_NUDGE, SPEEDS, 100);
  expect(Math.hypot(...position)).toBeCloseTo(0.2, 9);
});

test("after a long pause the camera does not jump", () => {
  const { position } = step(CAMERA, { ...STILL, forward: 1 }, NO_NUDGE, SPEEDS, 60_000);
  expect(position[2]).toBeLessThanOrEqual(0.2);
});

test("a nudge counts as it is, whatever the time", () => {
  const camera = step(CAMERA, STILL, { ...NO_NUDGE, turnRight: 10, forward: 0.5 }, SPEEDS, 0);
  expect(camera.azimuth).toBe(10);
  expect(Math.hypot(...camera.position)).toBeCloseTo(1, 9);
});

test("haste changes how fast one walks, straight or diagonally, and not how fast one turns", () => {
  const asked = { ...STILL, forward: 1, right: 1, turnRight: 1 };
  const usual = step(CAMERA, asked, NO_NUDGE, SPEEDS, 50);
  const fast = step(CAMERA, { ...asked, haste: 4 }, NO_NUDGE, SPEEDS, 50);
  expect(Math.hypot(...fast.position)).toBeCloseTo(4 * Math.hypot(...usual.position), 9);
  expect(fast.azimuth).toBe(usual.azimuth);
});

describe("the suggested speed suits the scene", () => {
  test.each([
    [12.2, 2],
    [4, 1],
    [100, 20],
    [0.05, 0.01],
    [1e6, 200_000],
  ])("a start view %f units deep gives %f units a second", (distance, speed) => {
    expect(suggestedSpeed(distance)).toBe(speed);
  });

  test.each([0, -1, Number.NaN, Number.POSITIVE_INFINITY])("%f gives 1", (distance) => {
    expect(suggestedSpeed(distance)).toBe(1);
  });
});
