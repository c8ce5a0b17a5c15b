import { beforeEach, expect, test } from "vitest";
import { HeldKeys } from "./keys";

const key = (code: string, modifiers = {}) => ({ code, ctrlKey: false, altKey: false, metaKey: false, ...modifiers });
const STILL = { forward: 0, right: 0, up: 0, turnRight: 0, turnUp: 0 };
let keys: HeldKeys;

beforeEach(() => {
  keys = new HeldKeys();
});

test.each([
  ["KeyW", { forward: 1 }],
  ["KeyS", { forward: -1 }],
  ["KeyA", { right: -1 }],
  ["KeyD", { right: 1 }],
  ["Space", { up: 1 }],
  ["KeyE", { up: 1 }],
  ["KeyQ", { up: -1 }],
  ["ShiftLeft", { up: -1 }],
  ["ShiftRight", { up: -1 }],
  ["ArrowLeft", { turnRight: -1 }],
  ["ArrowRight", { turnRight: 1 }],
  ["ArrowUp", { turnUp: 1 }],
  ["ArrowDown", { turnUp: -1 }],
])("%s moves as in the paper", (code, moved) => {
  expect(keys.press(key(code))).toBe(true);
  expect(keys.axes).toEqual({ ...STILL, ...moved });
  keys.release(code);
  expect(keys.axes).toEqual(STILL);
});

test("opposite keys cancel out, and both shifts are as fast as one", () => {
  for (const code of ["KeyA", "KeyD", "ShiftLeft", "ShiftRight"]) keys.press(key(code));
  expect(keys.axes).toEqual({ ...STILL, up: -1 });
});

test("a key makes walking faster, another one slower, for as long as it is held", () => {
  for (const code of ["KeyW", "KeyC"]) keys.press(key(code));
  expect(keys.axes).toEqual({ ...STILL, forward: 1, haste: 4 });
  keys.release("KeyC");
  keys.press(key("KeyZ"));
  expect(keys.axes.haste).toBe(0.25);
});

test("a key that repeats is held once", () => {
  keys.press(key("KeyW"));
  keys.press(key("KeyW"));
  keys.release("KeyW");
  expect(keys.axes).toEqual(STILL);
});

test("shortcuts of the browser and other keys are left alone", () => {
  expect(keys.press(key("KeyS", { ctrlKey: true }))).toBe(false);
  expect(keys.press(key("ArrowLeft", { altKey: true }))).toBe(false);
  expect(keys.press(key("KeyW", { metaKey: true }))).toBe(false);
  expect(keys.press(key("Tab"))).toBe(false);
  expect(keys.axes).toEqual(STILL);
});

test("when the page loses the focus nothing stays pressed", () => {
  keys.press(key("KeyW"));
  keys.releaseAll();
  expect(keys.axes).toEqual(STILL);
});
