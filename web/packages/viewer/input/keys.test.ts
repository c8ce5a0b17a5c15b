import { beforeEach, expect, test } from "vitest";
import { STILL } from "#fakes/rig";
import { HeldKeys } from "./keys";

const key = (code: string, modifiers = {}) => ({ code, ctrlKey: false, altKey: false, metaKey: false, ...modifiers });
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
  expect(keys.axes(1000)).toEqual({ ...STILL, ...moved });
  keys.release(code);
  expect(keys.axes(1000)).toEqual(STILL);
});

test("opposite keys cancel out, and both shifts are as fast as one", () => {
  for (const code of ["KeyA", "KeyD", "ShiftLeft", "ShiftRight"]) keys.press(key(code));
  expect(keys.axes(1000)).toEqual({ ...STILL, up: -1 });
});

test("a key makes walking faster, another one slower, for as long as it is held", () => {
  for (const code of ["KeyW", "KeyC"]) keys.press(key(code));
  expect(keys.axes(1000)).toEqual({ ...STILL, forward: 1, haste: 4 });
  keys.release("KeyC");
  keys.press(key("KeyZ"));
  expect(keys.axes(1000).haste).toBe(0.25);
});

test("a key that repeats is held once", () => {
  keys.press(key("KeyW"));
  keys.press(key("KeyW"));
  keys.release("KeyW");
  expect(keys.axes(1000)).toEqual(STILL);
});

test("shortcuts of the browser and other keys are left alone", () => {
  expect(keys.press(key("KeyS", { ctrlKey: true }))).toBe(false);
  expect(keys.press(key("ArrowLeft", { altKey: true }))).toBe(false);
  expect(keys.press(key("KeyW", { metaKey: true }))).toBe(false);
  expect(keys.press(key("Tab"))).toBe(false);
  expect(keys.axes(1000)).toEqual(STILL);
});

test("when the page loses the focus nothing stays pressed", () => {
  keys.press(key("KeyW"));
  keys.releaseAll();
  expect(keys.axes(1000)).toEqual(STILL);
});

test.each(["MetaLeft", "MetaRight"])(
  "keys released while %s is held, which macOS does not report, do not stick",
  (meta) => {
    keys.press(key("KeyW"));
    keys.press(key(meta, { metaKey: true }));
    expect(keys.axes(16)).toEqual(STILL);
    keys.press(key("KeyW"));
    keys.release(meta);
    expect(keys.axes(16)).toEqual(STILL);
  },
);

test("Shift sinks once it is held alone for a moment, as part of another combination not at all", () => {
  keys.press(key("ShiftLeft"));
  expect(keys.axes(150)).toEqual(STILL);
  expect(keys.axes(60)).toEqual({ ...STILL, up: -1 });
  keys.press(key("ShiftLeft")); // repeats
  keys.press(key("KeyW"));
  expect(keys.axes(16)).toEqual({ ...STILL, forward: 1, up: -1 });
  keys.press(key("Slash"));
  expect(keys.axes(1000)).toEqual({ ...STILL, forward: 1 });
});

test.each([
  ["ShiftRight", key("PrintScreen")],
  ["ShiftLeft", key("ControlLeft", { ctrlKey: true })],
  ["ShiftLeft", key("KeyS", { ctrlKey: true })],
])("%s with %o does not sink", (shift, other) => {
  keys.press(key(shift));
  keys.press(other);
  expect(keys.axes(1000)).toEqual(STILL);
});
