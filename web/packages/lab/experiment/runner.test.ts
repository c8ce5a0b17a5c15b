import { type Signal, signal } from "@preact/signals";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { steeredRig } from "#fakes/rig";
import { settle } from "#fakes/transport";
import type { EnhancementStatus } from "#viewer/enhance/enhancement";
import type { TimedPose } from "#viewer/movement/movement";
import { turning } from "#viewer/reproject/acceleration";
import type { ViewerSession } from "#viewer/session/session";
import { DEFAULT_SETTINGS } from "#viewer/state/settings";
import { ViewerState } from "#viewer/state/viewer-state";
import type { PresentedFrame } from "#viewer/view/presented";
import type { Rig } from "#viewer/view/rig";
import { Runner, type RunPlan } from "./runner";

const nothing = () => () => undefined;

const state = new ViewerState();
const { settings } = state;

let now: number;
let waiting: (() => void)[];
let page: EventTarget & { visibilityState: string };
let rig: Rig;
let enhancement: Signal<EnhancementStatus>;
let unturned: Signal<string | null>;
let phase: Signal<{ kind: string; message?: string }>;
/** Parts of the visit. */
let visit: Signal<{ kind: string; message?: string }>;
let runner: Runner;
let connections: number;
let present: (frame: PresentedFrame) => void;

beforeEach(() => {
  now = connections = 0;
  settings.value = DEFAULT_SETTINGS;
  turning.value = null;
  enhancement = signal({ kind: "off" });
  unturned = signal(null);
  phase = signal({ kind: "playing" });
  visit = signal({ kind: "playing" });
  waiting = [];
  page = Object.assign(new EventTarget(), { visibilityState: "visible" });
  vi.stubGlobal("document", page);
  vi.stubGlobal("navigator", { userAgent: "a browser" });
  vi.stubGlobal("requestAnimationFrame", (callback: () => void) => waiting.push(callback));
  vi.spyOn(performance, "now").mockImplementation(() => now);
  rig = steeredRig();
  const session = {
    state,
    rig,
    receivedBytes: 0,
    seed: signal(1),
    connected: signal(null),
    source: signal({ phase, enhancement: { status: enhancement }, played: () => ({}) }),
    sources: signal([{ played: () => ({}) }]),
    left: { picture: () => null },
    unturned,
    phase: visit,
    retry: () => {
      connections++;
    },
    onPresented: (listener: typeof present) => {
      present = listener;
      return nothing;
    },
    onShown: nothing,
    onSent: nothing,
    onReplied: nothing,
  };
  runner = new Runner(session as unknown as ViewerSession);
});

afterEach(() => {
  vi.restoreAllMocks();
});

/** The browser draws only at these times, in milliseconds. */
async function drawn(...times: number[]): Promise<void> {
  for (const time of times) {
    now = time;
    rig.sample(time);
    for (const callback of waiting.splice(0)) callback();
    await settle();
  }
}

/** A run with a resting camera. */
function stands(duration_ms: number, more: Partial<RunPlan> = {}) {
  const { position, quaternion } = rig.pose;
  return runner.run({
    points: [{ t_ms: 0, position, quaternion }],
    duration_ms,
    capture_every_ms: 0,
    sample_stride: 0,
    ...more,
  });
}

const every20 = (from: number, to: number) => Array.from({ length: (to - from) / 20 + 1 }, (_, i) => from + 20 * i);

test.each([
  ["was drawn from its start to its end", [every20(0, 4200)], true],
  ["stood for half a second", [every20(0, 1000), every20(1500, 4200)], true],
  ["stood for more than a second", [every20(0, 1000), every20(2100, 4200)], false],
  ["stood from its first moment on", [[0], every20(1100, 4200)], false],
  ["was hidden from its middle on until long after its end", [every20(0, 2000), every20(60_000, 60_200)], false],
  ["stood after its end", [every20(0, 4020), every20(5400, 5600)], true],
])("a movement of four seconds that %s", async (_, times, complete) => {
  await drawn(-20);
  const run = stands(4000);
  await drawn(...times.flat());
  await expect(run).resolves.toMatchObject({ complete, hidden: false });
});

test.each<[string, () => void, string]>([
  [
    "a visit that fails",
    () => {
      visit.value = { kind: "failed", message: "It is gone." };
    },
    "It is gone.",
  ],
  [
    "a download that fails",
    () => {
      phase.value = { kind: "failed", message: "No room." };
    },
    "No room.",
  ],
])("%s ends the run", async (_, happens, sentence) => {
  const run = stands(4000);
  const failed = expect(run).rejects.toThrow(sentence);
  await drawn(...every20(0, 100));
  happens();
  await drawn(...every20(120, 200));
  await failed;
});

test("a connection and a stream that come back are part of the record", async () => {
  const run = stands(400);
  await drawn(...every20(0, 100));
  visit.value = { kind: "lost" };
  phase.value = { kind: "connecting" };
  await drawn(...every20(120, 200));
  visit.value = phase.value = { kind: "playing" };
  await drawn(...every20(220, 600));
  await expect(run).resolves.toMatchObject({ complete: true });
});

test("the display's interval is that of the page at rest, in later runs, too", async () => {
  const { position, quaternion } = rig.pose;
  const points = [0, 4000].map((t_ms) => ({ t_ms, position: [t_ms, 0, 0], quaternion }) as TimedPose);
  const plan = { points, duration_ms: 200, capture_every_ms: 0, sample_stride: 0 };
  runner.stand({ position, quaternion });
  await drawn(...every20(0, 600));
  for (const start of [1000, 20_000]) {
    const run = runner.run(plan);
    await drawn(...Array.from({ length: 100 }, (_, i) => start + 60 * i));
    const { display_interval_ms, inputs } = await run;
    expect(display_interval_ms).toBe(20);
    expect(inputs.filter(({ missed }) => missed).length).toBeGreaterThan(5);
  }
});

test("a page that was hidden says so", async () => {
  const run = stands(1000);
  await drawn(...every20(0, 500));
  page.visibilityState = "hidden";
  page.dispatchEvent(new Event("visibilitychange"));
  page.visibilityState = "visible";
  await drawn(...every20(60_000, 60_200));
  await expect(run).resolves.toMatchObject({ complete: false, hidden: true });
});

test("a viewer is ready when its models are, and says why they are not used", () => {
  enhancement.value = { kind: "failed", message: "It took 40 ms per frame." };
  expect(runner.state()).toMatchObject({ problem: "It took 40 ms per frame." });
  enhancement.value = { kind: "starting", message: null };
  expect(runner.state()).toMatchObject({ ready: false, problem: null });
});

test("frames that were not turned for a while are a problem of the run, until settings are made again", async () => {
  const run = stands(200);
  await drawn(...every20(now, now + 100));
  expect(runner.state().problem).toBeNull();
  unturned.value = "The graphics processor was lost.";
  await drawn(...every20(now, now + 20));
  unturned.value = null;
  await drawn(...every20(now, now + 300));
  await run;
  expect(runner.state().problem).toContain("graphics processor was lost");
  runner.settings({});
  expect(runner.state().problem).toBeNull();
});

test("a stream that is opened anew is waited for, and a view that is there in the stateless mode is not", () => {
  for (const [mode, waits] of [
    ["dash", true],
    ["stateless", false],
  ] as const) {
    runner.settings({ mode, reprojection: true });
    present({ pose: rig.pose.seq } as PresentedFrame);
    expect(runner.state().ready).toBe(true);
    runner.settings({ reprojection: false });
    expect(runner.state().ready).toBe(!waits);
  }
});

test("after connecting again, only a new frame makes the viewer ready", () => {
  present({ pose: rig.pose.seq } as PresentedFrame);
  runner.reconnect();
  expect([connections, runner.state().ready]).toEqual([1, false]);
  present({ pose: rig.pose.seq } as PresentedFrame);
  expect(runner.state().ready).toBe(true);
});

test("reprojection that a run asks for is not left out for lack of graphics acceleration", () => {
  turning.value = "slow";
  runner.settings({ mode: "dash", reprojection: false });
  expect(turning.value).toBe("slow");
  runner.settings({ reprojection: true });
  expect(turning.value).toBe("forced");
});

test("a model that there is not is refused with those that there are", () => {
  expect(() => runner.settings({ upscale: "magic" })).toThrow("Unknown upscale model “magic”: use off, ");
  expect(settings.value.upscale).toBe("off");
});

test("a download begins with the recording, and until its first picture nothing is on the screen", async () => {
  vi.stubGlobal("ImageData", Array);
  vi.stubGlobal("createImageBitmap", async () => ({ width: 640, height: 360, close: () => undefined }));
  rig.resize(640, 360);
  present({ pose: rig.pose.seq, side: "stateless" } as PresentedFrame);
  const run = stands(400, { capture_every_ms: 100, download: true });
  expect(settings.value.mode).toBe("stateless");
  await drawn(0);
  expect(settings.value.mode).toBe("local");
  await drawn(...every20(20, 600));
  const { captures } = await run;
  expect(captures.length).toBeGreaterThanOrEqual(4);
  for (const capture of captures) expect(capture).toMatchObject({ pose: -1, view: null, width: 640, height: 360 });
  const size = vi.fn();
  class FakeCanvas {
    getContext = () => null;
    convertToBlob = async () => new Blob(["png"]);
    constructor(...sides: number[]) {
      size(...sides);
    }
  }
  vi.stubGlobal("OffscreenCanvas", FakeCanvas);
  expect(await (await runner.takePicture(0)).text()).toBe("png");
  expect(size).toHaveBeenCalledWith(640, 360);
  await expect(runner.takePicture(0)).rejects.toThrow("there is no picture 0");
});

test("a page that stands while it draws a download has played its movement, unless it was hidden", async () => {
  for (const visibilityState of ["visible", "hidden"]) {
    page.visibilityState = visibilityState;
    const run = stands(3000, { download: true });
    await drawn(...every20(now, now + 400), ...every20(now + 2400, now + 3600));
    await expect(run).resolves.toMatchObject({ complete: visibilityState === "visible" });
  }
  page.visibilityState = "visible";
  const held = stands(3000, { download: true });
  await drawn(...[0, 1000, 2000, 3000, 4000].map((after) => now + after));
  await expect(held, "a page with an animation frame a second").resolves.toMatchObject({ complete: false });
});

test("a download that fails is a problem of the run, in its own words", () => {
  phase.value = { kind: "failed", message: "The scene is too large for this browser." };
  expect(runner.state().problem).toBe("The scene is too large for this browser.");
});
