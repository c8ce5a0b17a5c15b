// @vitest-environment happy-dom

import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { asSession, type FakeSession, fakeSession } from "#fakes/session";
import { DEFAULT_SETTINGS } from "#viewer/state/settings";
import type { ScenePose } from "#viewer/view/camera";
import { keepAddress } from "./address";
import { settings, settingsOverridden } from "./app";
import { linkedPose } from "./link";
import { parseRoute } from "./route";

const SCENE = "#/scene/courtyard";
const ELSEWHERE: ScenePose = { position: [1, 2, 3], quaternion: [0, 0, 0, 1] };
let session: FakeSession;
let leave: () => void;
let now: number;

beforeEach(() => {
  vi.useFakeTimers();
  now = 0;
  settings.value = DEFAULT_SETTINGS;
  history.replaceState(null, "", SCENE);
  session = fakeSession();
  leave = keepAddress(asSession(session));
});

afterEach(() => {
  leave();
  settingsOverridden.value = false;
  vi.useRealTimers();
});

/** Runs animation frames for this many milliseconds. */
function animate(ms: number): void {
  for (const end = now + ms; now < end; now += 20) {
    session.rig.sample(now);
    vi.advanceTimersByTime(20);
  }
}

const position = () => {
  const at = parseRoute(location.hash);
  return at.page === "viewer" ? (linkedPose(at.asked)?.position ?? null) : null;
};

test("an address stays as it was opened until something changes", () => {
  animate(2000);
  expect(location.hash).toBe(SCENE);
});

test("it follows the camera once that rests, and only then", () => {
  const replace = vi.spyOn(history, "replaceState");
  animate(100);
  for (let i = 1; i <= 10; i++) {
    session.rig.place({ ...ELSEWHERE, position: [i, 2, 3] });
    animate(200);
  }
  expect(replace).not.toHaveBeenCalled();
  animate(600);
  expect(position()).toEqual([10, 2, 3]);
  animate(5000);
  expect(replace).toHaveBeenCalledTimes(1);
});

test("it names what was chosen, so that reloading does not undo it, and keeps what tests ask for", () => {
  history.replaceState(null, "", `${SCENE}?mode=dash`);
  settings.value = { ...DEFAULT_SETTINGS, mode: "webrtc", webrtcStream: "vp8-60" };
  animate(600);
  expect(location.hash).toMatch(/&mode=webrtc&webrtcStream=vp8-60$/);
});

test("what a script or an experiment does is none of it, and what the person does afterwards is", () => {
  session.rig.drive(() => ELSEWHERE);
  animate(1000);
  settingsOverridden.value = true;
  settings.value = { ...DEFAULT_SETTINGS, mode: "dash" };
  animate(1000);
  expect(location.hash).toBe(SCENE);
  settings.value = DEFAULT_SETTINGS;
  settingsOverridden.value = false;
  session.rig.takeOver();
  animate(1000);
  expect(position()).toEqual([1, 2, 3]);
});

test("a page that has moved on is not called back", () => {
  session.rig.place(ELSEWHERE);
  animate(100);
  history.replaceState(null, "", "#/");
  animate(1000);
  expect(location.hash).toBe("#/");
  history.replaceState(null, "", SCENE);
  session.rig.place({ ...ELSEWHERE, position: [4, 5, 6] });
  animate(100);
  leave();
  animate(1000);
  expect(location.hash).toBe(SCENE);
});
