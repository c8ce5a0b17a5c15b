import { beforeEach, expect, test, vi } from "vitest";
import { COURTYARD } from "#fakes/server";
import { settle } from "#fakes/transport";
import { DEFAULT_SETTINGS, type Settings, validSettings } from "../state/settings";
import type { ScenePose } from "../view/camera";
import { answerParent } from "./frame-messages";

const SITE = "https://lab.example";
const POSE: ScenePose = { position: [1, 2, 3], quaternion: [0, 0, 0, 1] };

let parent: { postMessage: ReturnType<typeof vi.fn> };
let frame: EventTarget & { parent: unknown };
let control: ReturnType<typeof fakeControl>;

function fakeControl() {
  return {
    camera: { position: [0, 0, 0], quaternion: [0, 0, 0, 1] } as ScenePose,
    settings: DEFAULT_SETTINGS,
    set(part: Partial<Settings>) {
      this.settings = validSettings({ ...this.settings, ...part });
    },
    animate: vi.fn(async () => true),
    screenshot: vi.fn(async () => new Blob(["png"])),
    on: vi.fn((_: string, listener: (scene: typeof COURTYARD) => void) => {
      listener(COURTYARD);
      return () => undefined;
    }),
  };
}

beforeEach(() => {
  parent = { postMessage: vi.fn() };
  frame = Object.assign(new EventTarget(), { parent });
  control = fakeControl();
  answerParent(control as never, frame as never);
  expect(parent.postMessage).toHaveBeenCalledWith({ tigas: "loaded", scene: "courtyard" }, "*");
  parent.postMessage.mockClear();
});

async function send(data: unknown, source: unknown = parent, origin = SITE): Promise<unknown> {
  frame.dispatchEvent(Object.assign(new Event("message"), { data, source, origin }));
  await settle();
  return parent.postMessage.mock.lastCall?.[0];
}

test("the camera is read, placed, and moved", async () => {
  expect(await send({ tigas: "camera", id: 1 })).toEqual({ tigas: "camera", id: 1, camera: control.camera });
  expect(await send({ tigas: "camera", id: 2, camera: POSE })).toEqual({ tigas: "camera", id: 2, camera: POSE });
  await send({ tigas: "camera", camera: POSE, duration: 500, easing: "linear" });
  expect(control.animate).toHaveBeenCalledWith(POSE, { duration: 500, easing: "linear" });
  expect(parent.postMessage).toHaveBeenCalledWith(expect.anything(), SITE);
});

test("settings are read and changed, and a picture is taken", async () => {
  expect(await send({ tigas: "settings", settings: { mode: "local" } })).toMatchObject({ settings: { mode: "local" } });
  expect(await send({ tigas: "screenshot", id: "a", width: 800 })).toEqual({
    tigas: "screenshot",
    id: "a",
    screenshot: expect.any(Blob),
  });
  expect(control.screenshot).toHaveBeenCalledWith({ width: 800 });
});

test.each([
  [{ tigas: "camera", camera: { position: [1], quaternion: "x" } }, "camera"],
  [{ tigas: "camera", camera: 5 }, "camera"],
  [{ tigas: "settings", settings: { mode: "magic" } }, "mode"],
  [{ tigas: "toString" }, "toString"],
])("%j is answered with the reason", async (message, reason) => {
  expect(await send({ ...message, id: 9 })).toEqual({
    tigas: message.tigas,
    id: 9,
    error: expect.stringContaining(reason),
  });
  expect(control.camera.position).toEqual([0, 0, 0]);
});

test.each([
  ["another window", { tigas: "camera" }, {}, SITE],
  ["a page without an origin", { tigas: "camera" }, undefined, "null"],
  ["other software", { type: "camera" }, undefined, SITE],
  ["other software", null, undefined, SITE],
])("%s is not answered", async (_, data, source, origin) => {
  await send(data, source ?? parent, origin);
  expect(parent.postMessage).not.toHaveBeenCalled();
});

test("a page in no frame answers nobody", () => {
  const alone = Object.assign(new EventTarget(), { parent: null as unknown });
  alone.parent = alone;
  const added = vi.spyOn(alone, "addEventListener");
  answerParent(control as never, alone as never)();
  expect(added).not.toHaveBeenCalled();
});
