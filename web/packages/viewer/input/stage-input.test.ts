// @vitest-environment happy-dom
import { afterEach, beforeEach, expect, test } from "vitest";
import { StageInput } from "./stage-input";

let input: StageInput;
let anywhere: boolean;

beforeEach(() => {
  document.body.innerHTML = `
    <div id="stage" tabindex="0"></div>
    <button></button>
    <a href="#"></a>
    <select></select>
    <input type="radio" />
    <input type="text" />`;
  anywhere = true;
  input = open({ sharesPage: false });
});

afterEach(() => input.dispose());

function open({ sharesPage }: { sharesPage: boolean }): StageInput {
  const focal = () => ({ fx: 500, fy: 500 });
  return new StageInput(element("#stage"), {
    focal,
    orbits: () => false,
    keysAnywhere: () => anywhere,
    onFocus: () => undefined,
    sharesPage,
  });
}

function element(selector: string): HTMLElement {
  const found = document.querySelector<HTMLElement>(selector);
  if (!found) throw new Error(`there is no ${selector}`);
  return found;
}

/** Whether the camera moves after a key press, and whether the browser's default action is performed. */
function press(code: string, where: string): { moves: boolean; browser: boolean } {
  const event = new KeyboardEvent("keydown", { code, bubbles: true, cancelable: true });
  element(where).dispatchEvent(event);
  const moves = Object.values(input.sample(1000).axes).some((axis) => axis !== 0);
  return { moves, browser: !event.defaultPrevented };
}

const THE_CAMERA = { moves: true, browser: false };
const THE_PAGE = { moves: false, browser: true };

test.each([
  ["KeyW", "#stage", THE_CAMERA],
  ["ShiftLeft", "#stage", THE_CAMERA],
  ["Space", "#stage", THE_CAMERA],
  ["ArrowLeft", "#stage", THE_CAMERA],
  ["KeyW", "button", THE_CAMERA],
  ["ArrowLeft", "button", THE_CAMERA],
  ["Space", "button", THE_PAGE],
  ["ShiftLeft", "button", THE_PAGE],
  ["ShiftRight", "a", THE_PAGE],
  ["ShiftLeft", "input[type=radio]", THE_PAGE],
  ["ArrowLeft", "input[type=radio]", THE_PAGE],
  ["KeyW", "input[type=text]", THE_PAGE],
  ["ArrowDown", "select", THE_PAGE],
])("%s on %s is heard by %j", (code, where, heard) => {
  expect(press(code, where)).toEqual(heard);
});

test.each([
  ["KeyW", "#stage", THE_CAMERA],
  ["KeyW", "button", THE_PAGE],
])("without single-key shortcuts, %s on %s is heard by %j", (code, where, heard) => {
  anywhere = false;
  expect(press(code, where)).toEqual(heard);
});

test("whoever goes back with Shift and Tab does not sink", () => {
  expect(press("ShiftLeft", "#stage")).toEqual(THE_CAMERA);
  expect(press("Tab", "#stage")).toEqual(THE_PAGE);
});

test("keys held while Cmd is pressed and released do not stick", () => {
  expect(press("KeyW", "#stage")).toEqual(THE_CAMERA);
  press("MetaLeft", "#stage");
  element("#stage").dispatchEvent(new KeyboardEvent("keyup", { code: "MetaLeft", bubbles: true }));
  expect(Object.values(input.sample(16).axes).every((axis) => axis === 0)).toBe(true);
});

test("a trackpad's pinch moves the camera instead of zooming the page", () => {
  const event = new WheelEvent("wheel", { deltaY: -10, ctrlKey: true, cancelable: true });
  element("#stage").dispatchEvent(event);
  expect(event.defaultPrevented).toBe(true);
  expect(input.sample(1000).nudge.forward).toBeGreaterThan(0);
});

test("mouse look that the browser refuses is not an error", async () => {
  element("#stage").requestPointerLock = () => Promise.reject(new DOMException("too soon after Esc"));
  await expect(input.lock()).resolves.toBeUndefined();
});

test("beside other content the camera moves only while the stage has the focus", () => {
  input.dispose();
  input = open({ sharesPage: true });
  const scroll = () => {
    const event = new WheelEvent("wheel", { deltaY: -10, cancelable: true });
    element("#stage").dispatchEvent(event);
    return { moves: input.sample(1000).nudge.forward > 0, browser: !event.defaultPrevented };
  };
  element("button").focus();
  expect(press("KeyW", "button")).toEqual(THE_PAGE);
  expect(scroll()).toEqual(THE_PAGE);
  element("#stage").focus();
  expect(press("KeyW", "#stage")).toEqual(THE_CAMERA);
  expect(scroll()).toEqual(THE_CAMERA);
  element("button").focus();
  expect(Object.values(input.sample(1000).axes).every((axis) => axis === 0)).toBe(true);
});

test.each(["before", "after"])("a gamepad moves the camera that was connected %s the viewer was opened", (when) => {
  const pads: object[] = [];
  Object.assign(navigator, { getGamepads: () => pads });
  const connect = () => pads.push({ mapping: "standard", axes: [1, 0, 0, 0], buttons: [] });
  if (when === "before") connect();
  const opened = open({ sharesPage: false });
  if (when === "after") {
    connect();
    dispatchEvent(new Event("gamepadconnected"));
  }
  expect(opened.sample(16).axes.right).toBe(1);
  opened.dispose();
  Reflect.deleteProperty(navigator, "getGamepads");
});
