import { expect, test } from "vitest";
import { gamepadAxes } from "./gamepad";

const up = { value: 0, pressed: false };
const down = { value: 1, pressed: true };
const pad = (axes: number[], pressed: number[] = [], mapping = "standard") => ({
  mapping,
  axes,
  buttons: Array.from({ length: 17 }, (_, i) => (pressed.includes(i) ? down : up)),
});

test("sticks walk and turn, triggers rise and sink, a bumper hastens", () => {
  expect(gamepadAxes([null, pad([1, -1, -1, 1], [7, 5])])).toEqual({
    right: 1,
    forward: 1,
    turnRight: -1,
    turnUp: -1,
    up: 1,
    haste: 4,
  });
  expect(gamepadAxes([pad([0, 0, 0, 0], [6, 4])])).toMatchObject({ up: -1, haste: 0.25 });
});

test("a stick that nobody touches asks for nothing, nor does a device of another layout", () => {
  expect(gamepadAxes([pad([0.1, -0.14, 0.05, 0])])).toBeNull();
  expect(gamepadAxes([pad([1, 1, 1, 1], [], "")])).toBeNull();
  expect(gamepadAxes([])).toBeNull();
});
