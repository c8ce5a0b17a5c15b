// @vitest-environment happy-dom
import { type Signal, signal } from "@preact/signals";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import type { EnhancementStatus } from "../enhance/enhancement";
import type { TimedPose } from "../movement/playback";
import { ShaperError } from "../network/api";
import type { Shaper } from "../network/shaper";
import { changeSettings, settings } from "../state/app";
import { COURTYARD } from "../state/fake-server";
import { DEFAULT_SETTINGS } from "../state/settings";
import { settle } from "../transport/fake";
import type { ViewerSession } from "../viewer/session";
import type { ShaperStatus } from "../wire/shaper";
import type { Recording } from "../wire/store";
import { RunFailed } from "./errors";
import { measure } from "./measure";
import { type PlannedRun, UNSHAPED } from "./plan";
import type { Runner, RunPlan } from "./runner";

const FIRST: TimedPose = { t_ms: 0, position: [1, 2, 3], quaternion: [0, 0, 0, 1] };
const RUN: PlannedRun = {
  scene: "courtyard",
  movement: "stroll",
  network: { link: null, trace: "bus", rtt_ms: 80 },
  mode: "stateless",
  profile: "budget",
  movement_offset_s: 0,
  segment: 0,
  seed: 1,
  repeat: 0,
  duration_s: 10,
  warm_up_s: 3,
  capture_every_ms: 0,
  sample_stride: 0,
  dash_frame_rate: null,
  restore: "off",
  upscale: "off",
  reprojection: false,
  prediction: "off",
  overscan: "auto",
  depth: true,
  surround: true,
  dash_representation: null,
};
const DIRECTION = { target_kbps: 20_000, delivered_kbps: 100, queue_ms: 1, drops: 0 };
const PLAYING = {
  mode: "playing",
  trace: "bus",
  closed: null,
  time_ms: 1000,
  position_ms: 0,
  duration_ms: 30_000,
  link: { down_kbps: 20_000, up_kbps: 5000, delay_ms: 40, jitter_ms: 0, loss_pct: 0 },
  down: DIRECTION,
  up: DIRECTION,
} as ShaperStatus;
const PROMISED = { complete: true, hidden: false, ended_ms: 10_100, frames: [{}] } as unknown as Recording;

/** Actions, in order. */
let events: string[];
let now: number;
let playedAt: number;
let ready: boolean;
let problem: string | null;
let recording: Recording;
/** Events during the movement. */
let meanwhile: () => void;
let points: readonly TimedPose[];
let shaper: ReturnType<typeof fakeShaper>;
let session: ReturnType<typeof fakeSession>;
let cancelling: AbortController;
let stood: object;
let played: RunPlan;

function fakeShaper() {
  const ask = (name: string) => async (what?: unknown) => {
    events.push(what === undefined ? name : `${name} ${JSON.stringify(what)}`);
    return PLAYING;
  };
  const api = { start: ask("start"), pause: ask("pause"), seek: ask("seek"), resume: ask("resume"), stop: ask("stop") };
  return { api, status: signal<ShaperStatus | null>(PLAYING), connectionError: signal<string | null>(null) };
}

function fakeSession() {
  return {
    phase: signal<{ kind: string; message?: string }>({ kind: "playing" }),
    source: signal<{
      phase: Signal<{ kind: string; message?: string }>;
      enhancement: { status: Signal<EnhancementStatus> };
    } | null>({ phase: signal({ kind: "playing" }), enhancement: { status: signal({ kind: "off" }) } }),
    scene: signal(COURTYARD),
    unturned: signal<string | null>(null),
    rig: { viewport: signal({ width: 640, height: 360 }), intrinsics: signal({ fx: 300, fy: 300, cx: 320, cy: 180 }) },
    retry: () => events.push("connect anew"),
  };
}

type FakeSource = NonNullable<ReturnType<typeof fakeSession>["source"]["value"]>;

const discarded = vi.fn(async () => undefined);
const runner = {
  discardSamples: discarded,
  stand: (pose: object) => {
    stood = pose;
    events.push("stand at the first pose");
  },
  settings: (part: object) => changeSettings(part),
  seed: vi.fn(),
  state: () => ({ ready, problem }),
  run: (plan: RunPlan, signal: AbortSignal) =>
    new Promise((resolve, reject) => {
      events.push("play");
      played = plan;
      playedAt = now;
      signal.addEventListener("abort", () => reject(signal.reason));
      recording = { ...recording, started_unix_ms: performance.timeOrigin + now };
      meanwhile();
      setTimeout(() => resolve(recording), 10_100);
    }),
};

beforeEach(() => {
  vi.useFakeTimers({ toFake: ["setTimeout", "clearTimeout", "performance"] });
  vi.spyOn(performance, "now").mockImplementation(() => now);
  settings.value = DEFAULT_SETTINGS;
  events = [];
  now = 0;
  ready = true;
  problem = null;
  recording = PROMISED;
  points = [FIRST];
  meanwhile = () => undefined;
  shaper = fakeShaper();
  session = fakeSession();
  cancelling = new AbortController();
});

afterEach(() => {
  vi.useRealTimers();
  vi.restoreAllMocks();
});

/** Makes the run; `status` follows the clock, as the shaper's events do, for as long as `told` says. */
async function measured(run: Partial<PlannedRun> = {}, { told = Number.POSITIVE_INFINITY } = {}) {
  const context = {
    session: session as unknown as ViewerSession,
    runner: runner as unknown as Runner,
    shaper: shaper as unknown as Shaper,
    points,
    experiment: () => ({ name: "two", plan: { seed: 1 }, experiment: "e1" }),
  };
  const stages: string[] = [];
  const made = measure(context, { ...RUN, ...run }, (stage) => stages.push(stage), cancelling.signal);
  const outcome = made.catch((error: Error) => error);
  let done = false;
  void outcome.finally(() => {
    done = true;
  });
  for (let i = 0; !done && i < 2000; i++) {
    now += 50;
    await vi.advanceTimersByTimeAsync(50);
    const status = shaper.status.peek();
    if (status && events.includes("play") && now < told) {
      shaper.status.value = { ...status, time_ms: status.time_ms + 50, position_ms: (status.position_ms ?? 0) + 50 };
    }
    await settle();
  }
  return { outcome: await outcome, stages };
}

test("a part begins within trace and movement, and the controller has the run's seed", async () => {
  points = [FIRST, { ...FIRST, t_ms: 10_000, position: [11, 2, 3] }];
  const network = { ...RUN.network, offset_s: 2.5 };
  const { outcome } = await measured({ network, movement_offset_s: 5, segment: 1, seed: 7 });
  expect(outcome).toMatchObject({ configuration: { network, movement_offset_s: 5, segment: 1, seed: 7 } });
  expect(events.filter((event) => event.startsWith("seek"))).toEqual(["seek 2500", "seek 2500"]);
  expect(stood).toMatchObject({ position: [6, 2, 3] });
  expect(played.points.map(({ t_ms }) => t_ms)).toEqual([-5000, 5000]);
  expect(runner.seed).toHaveBeenCalledWith(7);
});

test("holds the network at its start, warms up, and plays link and movement together", async () => {
  const { outcome, stages } = await measured();
  expect(stages).toEqual(["Connects", "Waits for the first view", "Warms up", "Plays the movement"]);
  expect(events).toEqual([
    "stand at the first pose",
    "connect anew",
    'start {"trace":"bus","loop":true,"delay_ms":40}',
    "pause",
    "seek 0",
    "seek 0",
    "resume",
    "play",
    "stand at the first pose",
    "stop",
  ]);
  expect(playedAt).toBeGreaterThanOrEqual(RUN.warm_up_s * 1000);
  expect(outcome).toMatchObject({
    configuration: { ...RUN, width: 640, height: 360 },
    recording: { ended_ms: 10_100 },
    scene_bytes: 20_000_000,
  });
  expect(settings.value).toMatchObject({ mode: "stateless", controller: "budget", refine: false });
});

test("the link is told on the recording's own clock, and only of its time", async () => {
  const { outcome } = await measured();
  const { link } = outcome as { link: { at: number; target_kbps: number }[] };
  expect(link[0]).toMatchObject({ at: 0, target_kbps: 20_000 });
  expect(link.at(-1)?.at).toBeLessThanOrEqual(10_100);
  expect(link.length).toBeGreaterThan(100);
});

test("to the link as it is nothing is done", async () => {
  const { outcome } = await measured({ network: UNSHAPED });
  expect(outcome).toMatchObject({ recording: { complete: true } });
  expect(events).toEqual(["stand at the first pose", "connect anew", "play", "stand at the first pose"]);
});

test.each<[string, Partial<PlannedRun>, () => void]>([
  [
    "The connection was lost during the run.",
    {},
    () => {
      session.phase.value = { kind: "lost" };
    },
  ],
  [
    "Garden was deleted or renamed on the server.",
    {},
    () => {
      session.phase.value = { kind: "failed", message: "Garden was deleted or renamed on the server." };
    },
  ],
  [
    "The DASH stream was lost during the run.",
    { mode: "dash-tuned" },
    () => {
      session.source.value = null;
    },
  ],
  ["Settings or the window's size were changed during the run.", {}, () => changeSettings({ controller: "l2a" })],
  [
    "Settings or the window's size were changed during the run.",
    {},
    () => {
      session.rig.viewport.value = { width: 600, height: 360 };
    },
  ],
  [
    "The link was changed from outside during the run.",
    {},
    () => {
      shaper.status.value = { ...PLAYING, trace: "train", time_ms: 1100 };
    },
  ],
  [
    "The shaper is away.",
    {},
    () => {
      shaper.connectionError.value = "The shaper is away.";
      shaper.status.value = null;
    },
  ],
])("a run is given up: %s", async (sentence, run, happens) => {
  meanwhile = happens;
  const { outcome } = await measured(run);
  expect(outcome).toMatchObject({ message: sentence });
  expect(events.slice(-2), "camera and link are given back").toEqual(["stand at the first pose", "stop"]);
});

test("what does not decide what is measured may be changed meanwhile", async () => {
  meanwhile = () => changeSettings({ theme: "dark", turnSpeed: 90 });
  expect((await measured()).outcome).toMatchObject({ recording: { complete: true } });
});

test.each<[string, Partial<Recording>]>([
  ["The movement was not played to its end without a pause.", { complete: false }],
  ["The page was hidden, so that not all of the run could be shown.", { complete: false, hidden: true }],
  ["No frame came during the run.", { frames: [] }],
])("a recording that says too little fails: %s", async (sentence, part) => {
  recording = { ...PROMISED, ...part };
  expect((await measured()).outcome).toMatchObject({ message: sentence });
});

test("a shaper that falls silent is noticed", async () => {
  expect((await measured({}, { told: 8000 })).outcome).toMatchObject({
    message: "The shaper fell silent during the run.",
  });
});

test.each([
  ["nobody says", { kind: "playing" }, "No frame came within 60 s."],
  ["the viewer says", { kind: "lost", message: "The server does not answer." }, "The server does not answer."],
])("without a first view the run fails after a minute, with the reason that %s", async (_, phase, sentence) => {
  ready = false;
  session.retry = () => {
    setTimeout(() => {
      session.phase.value = phase;
    }, 1000);
    return 0;
  };
  const { outcome } = await measured();
  expect(outcome).toMatchObject({ message: sentence });
  expect(now).toBeGreaterThan(60_000);
  expect(events).not.toContain("play");
  expect(events.at(-1)).toBe("stop");
});

test("nothing is measured in a page that nobody sees", async () => {
  vi.spyOn(document, "visibilityState", "get").mockReturnValue("hidden");
  const { outcome } = await measured();
  expect(outcome).toMatchObject({ message: "The page was hidden, so that not all of the run could be shown." });
  expect(events).not.toContain("play");
});

test("samples know their run, and those of a run that fails are removed", async () => {
  discarded.mockClear();
  await measured({ sample_stride: 30 });
  expect(played).toMatchObject({
    sample_stride: 30,
    about: {
      name: "two",
      plan: { seed: 1 },
      experiment: "e1",
      run: null,
      configuration: { scene: "courtyard", width: 640 },
    },
  });
  expect(discarded).not.toHaveBeenCalled();
  meanwhile = () => cancelling.abort(new Error("cancelled"));
  await measured({ sample_stride: 30 });
  expect(discarded).toHaveBeenCalledTimes(1);
});

test("a run that is cancelled ends at once, and gives the link back", async () => {
  meanwhile = () => cancelling.abort(new Error("cancelled"));
  const { outcome } = await measured();
  expect(outcome).toMatchObject({ message: "cancelled" });
  expect(now).toBeLessThan(5000);
  expect(events.at(-1)).toBe("stop");
});

test("a shaper that refuses fails the run in its own words; one that cannot be given back does not", async () => {
  shaper.api.stop = async () => {
    throw new ShaperError("The shaper does not answer.");
  };
  expect((await measured()).outcome).toMatchObject({ recording: { complete: true } });
  shaper.api.start = async () => {
    throw new ShaperError("There is no trace bus.");
  };
  expect((await measured()).outcome).toMatchObject({ message: "There is no trace bus." });
});

test("models that cannot be used fail the run before it plays, with the reason", async () => {
  problem = "There are no weights for this scene.";
  const { outcome } = await measured({ upscale: "bicubic" });
  expect(outcome).toEqual(new RunFailed("Frames cannot be shown as configured. There are no weights for this scene."));
  expect(events).not.toContain("play");
});

test("models that are given up meanwhile fail the run", async () => {
  meanwhile = () => {
    (session.source.value as FakeSource).enhancement.status.value = {
      kind: "failed",
      message: "It took 40 ms a frame.",
    };
  };
  const { outcome } = await measured({ upscale: "bicubic" });
  expect(outcome).toEqual(new RunFailed("Enhancement was given up during the run. It took 40 ms a frame."));
});

test("a graphics processor that is lost meanwhile fails the run", async () => {
  meanwhile = () => {
    session.unturned.value = "The graphics processor was lost, so frames are shown as they come.";
  };
  const { outcome } = await measured({ mode: "stateless", reprojection: true });
  expect(outcome).toBeInstanceOf(RunFailed);
  expect(String(outcome)).toContain("Reprojection ended during the run. The graphics processor was lost");
});

test("a download begins when the movement does, and none of it that comes in time is a result", async () => {
  recording = { ...PROMISED, frames: [] };
  const modes: string[] = [];
  meanwhile = () => {
    modes.push(settings.value.mode);
    changeSettings({ mode: "local" });
  };
  const { outcome } = await measured({ mode: "local-compressed" });
  expect(outcome).toMatchObject({ configuration: { mode: "local-compressed" }, recording: { complete: true } });
  expect([played.download, modes]).toEqual([true, ["stateless"]]);
});

test("a scene that this browser cannot draw fails the run, in the viewer's words", async () => {
  meanwhile = () => {
    const phase = { kind: "failed", message: "The scene is too large for this browser." };
    (session.source.value as FakeSource).phase.value = phase;
  };
  const { outcome } = await measured({ mode: "local-compressed" });
  expect(outcome).toMatchObject({ message: "The scene is too large for this browser." });
});
