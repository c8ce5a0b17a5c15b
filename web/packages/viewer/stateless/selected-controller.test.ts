import { computed, signal } from "@preact/signals";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { PAPER_LADDER } from "#client/abr/ladder";
import { CONTROLLERS } from "#client/abr/registry";
import { DEFAULT_SETTINGS, type SideSettings } from "../state/settings";
import { ViewerState } from "../state/viewer-state";
import { selectedController, videoSteps } from "./selected-controller";

const create = vi.spyOn(CONTROLLERS["lol+"], "create");
const { settings, config, ladder, sceneLadder } = new ViewerState();
const side = computed((): SideSettings => ({ ...settings.value, mode: "stateless" }));
const HD = signal(1280 * 720);
const configured = (ladder = PAPER_LADDER) => ({ ladder: structuredClone(ladder) }) as never;

beforeEach(() => {
  config.value = configured();
  settings.value = { ...DEFAULT_SETTINGS, controller: "lol+" };
  create.mockClear();
});

afterEach(() => {
  config.value = null;
  sceneLadder.value = null;
  settings.value = DEFAULT_SETTINGS;
});

test("a seed decides a controller's random numbers", () => {
  const numbers = (seed: number) => {
    selectedController(side, ladder, signal(seed), HD, videoSteps(false, side, ladder, HD)).value;
    const random = create.mock.lastCall?.[0].random ?? Math.random;
    return [random(), random(), random()];
  };
  const first = numbers(7);
  expect(numbers(7)).toEqual(first);
  expect(numbers(8)).not.toEqual(first);
});

test("a controller stays for as long as choice, ladder and seed do", () => {
  const seed = signal(1);
  const controller = selectedController(side, ladder, seed, HD, videoSteps(false, side, ladder, HD));
  const first = controller.value;
  config.value = configured();
  settings.value = { ...settings.value, refine: false };
  expect(controller.value).toBe(first);
  seed.value = 2;
  const second = controller.value;
  expect(second).not.toBe(first);
  config.value = configured(PAPER_LADDER.slice(1));
  expect(controller.value).not.toBe(second);
});

test("the rung that a person chose, or the last of a shorter ladder", () => {
  settings.value = { ...DEFAULT_SETTINGS, controller: "fixed", profile: 9 };
  expect(selectedController(side, ladder, signal(1), HD, videoSteps(false, side, ladder, HD)).value.decide(0)).toBe(3);
  config.value = null;
  expect(selectedController(side, ladder, signal(1), HD, videoSteps(false, side, ladder, HD)).value.decide(0)).toBe(0);
});

test("a scene's own ladder is the controller's, and the server's again afterwards", () => {
  const own = Array.from({ length: 9 }, (_, i) => ({
    name: `${9 - i}`,
    width: 1280 - 64 * i,
    height: 720 - 36 * i,
    quality: 80,
    expected_kb: 200 / 2 ** i,
  }));
  const controller = selectedController(side, ladder, signal(1), HD, videoSteps(false, side, ladder, HD));
  sceneLadder.value = own;
  controller.value;
  expect(create.mock.lastCall?.[0].ladder).toEqual(own);
  settings.value = { ...DEFAULT_SETTINGS, controller: "fixed", profile: 8 };
  expect(controller.value.decide(0)).toBe(8);
  sceneLadder.value = null;
  expect(controller.value.decide(0)).toBe(3);
});

test("rungs larger than the picture are not offered, but can be chosen", () => {
  const pixels = signal(640 * 360);
  const controller = selectedController(side, ladder, signal(1), pixels, videoSteps(false, side, ladder, pixels));
  const offered = () => {
    controller.value;
    return create.mock.lastCall?.[0].ladder;
  };
  expect(offered()).toEqual(PAPER_LADDER.slice(2));
  const first = controller.value;
  pixels.value = 600 * 340;
  expect(controller.value).toBe(first);
  pixels.value = 4 * 640 * 360;
  expect(offered()).toEqual(PAPER_LADDER);
  settings.value = { ...DEFAULT_SETTINGS, controller: "fixed", profile: 0 };
  pixels.value = 1;
  expect(controller.value.decide(0)).toBe(0);
});
