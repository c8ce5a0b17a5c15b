import { describe, expect, test } from "vitest";
import { NO_NUDGE } from "../view/motion";
import { look, pinch, sum, wheel } from "./gestures";

const at = (x: number, y: number) => ({ x, y });

describe("dragging", () => {
  test("the picture follows the pointer: dragging right looks left, dragging down looks up", () => {
    const nudge = look(at(100, 100), at(150, 120), { fx: 700, fy: 700 });
    expect(nudge.turnRight).toBeLessThan(0);
    expect(nudge.turnUp).toBeGreaterThan(0);
  });

  test("what was in the middle stays under the pointer", () => {
    const { turnRight } = look(at(0, 0), at(-700, 0), { fx: 700, fy: 700 });
    expect(turnRight).toBeCloseTo(45, 9);
  });
});

describe("the wheel", () => {
  test("away from the person goes forward, by as much in every unit", () => {
    const pixels = wheel({ ctrlKey: false, deltaY: -100, deltaMode: 0 });
    expect(pixels).toBeGreaterThan(0);
    expect(wheel({ ctrlKey: false, deltaY: -3, deltaMode: 1 })).toBeCloseTo(pixels, 9);
    expect(wheel({ ctrlKey: false, deltaY: -1, deltaMode: 2 })).toBeCloseTo(pixels, 9);
    expect(wheel({ ctrlKey: false, deltaY: 100, deltaMode: 0 })).toBeCloseTo(-pixels, 9);
  });

  test("a pinch on a trackpad, which comes in small steps with Ctrl, goes as far as fingers on a screen", () => {
    const steps = Array.from({ length: 12 }, () => wheel({ ctrlKey: true, deltaY: -6, deltaMode: 0 }));
    expect(steps.reduce((a, b) => a + b)).toBeGreaterThan(1);
    const notch = wheel({ ctrlKey: false, deltaY: -100, deltaMode: 0 });
    expect(wheel({ ctrlKey: true, deltaY: -100, deltaMode: 0 }), "a mouse's wheel with Ctrl").toBe(notch);
  });

  test("a wild spin is no teleporter", () => {
    expect(wheel({ ctrlKey: false, deltaY: -1e9, deltaMode: 0 })).toBeLessThanOrEqual(1);
  });
});

describe("two fingers", () => {
  test("apart goes forward, together goes back by as much", () => {
    const apart = pinch([at(100, 100), at(200, 100)], [at(50, 100), at(250, 100)], 800);
    const together = pinch([at(50, 100), at(250, 100)], [at(100, 100), at(200, 100)], 800);
    expect(apart.forward).toBeGreaterThan(0);
    expect(together.forward).toBeCloseTo(-apart.forward, 9);
    expect([apart.right, apart.up].map(Math.abs)).toEqual([0, 0]);
  });

  test("both in one direction drag the scene along", () => {
    const nudge = pinch([at(100, 100), at(200, 100)], [at(140, 160), at(240, 160)], 800);
    expect(nudge.forward).toBe(0);
    expect(nudge.right).toBeLessThan(0);
    expect(nudge.up).toBeGreaterThan(0);
  });

  test("fingers on one spot make no infinity", () => {
    const { forward } = pinch([at(5, 5), at(5, 5)], [at(5, 5), at(300, 5)], 0);
    expect(Number.isFinite(forward)).toBe(true);
  });
});

test("nudges between two samples add up", () => {
  const one = { ...NO_NUDGE, turnRight: 1, forward: 2 };
  const more = { ...NO_NUDGE, up: 3, orbitRight: 4 };
  expect(sum(one, sum(one, more))).toEqual({ ...NO_NUDGE, turnRight: 2, forward: 4, up: 3, orbitRight: 4 });
});
