// @vitest-environment happy-dom
import { signal } from "@preact/signals";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { ApiError } from "#client/http/problem";
import type { ShaperStatus } from "#client/wire/shaper";
import type { Recording, RunJob } from "#client/wire/store";
import { PLAYING } from "#fakes/shaper";
import type { ViewerSession } from "#viewer/session/session";
import type { Shaper } from "../network/shaper";
import { RunFailed } from "./errors";
import { perform } from "./perform";
import type { Runner } from "./runner";

const FIRST = { t_ms: 0, position: [1, 2, 3], quaternion: [0, 0, 0, 1] };
const JOB = {
  run: "r",
  title: "Seen",
  configuration: { network: { trace: "bus" }, warm_up_s: 3 },
  settings: { seed: 7, mode: "stateless" },
  plan: { points: [FIRST], duration_ms: 1000, capture_every_ms: 0, sample_stride: 0, download: false },
} as unknown as RunJob;
const STATUS: ShaperStatus = { ...PLAYING, position_ms: 0 };

let events: string[];
let phase: { kind: string; message?: string };
let ready: boolean;
let problem: string | null;
let meanwhile: () => void;
let refused: boolean;
let status: ReturnType<typeof signal<ShaperStatus | null>>;
let cancelling: AbortController;
const discardSamples = vi.fn(async () => undefined);

beforeEach(() => {
  vi.useFakeTimers({ toFake: ["setTimeout", "clearTimeout", "performance"] });
  events = [];
  phase = { kind: "playing" };
  ready = true;
  problem = null;
  meanwhile = () => undefined;
  refused = false;
  status = signal<ShaperStatus | null>(STATUS);
  cancelling = new AbortController();
});

afterEach(() => {
  vi.useRealTimers();
  vi.clearAllMocks();
});

async function performed() {
  const ask = (name: string) => async () => {
    events.push(name);
    if (refused && name === "start") throw new ApiError("There is no trace bus.", false);
    return STATUS;
  };
  const names = ["start", "seek", "stop"];
  const api = { ...Object.fromEntries(names.map((name) => [name, ask(name)])), abandon: () => events.push("abandon") };
  const runner = {
    stand: () => events.push("stand"),
    seed: (seed: number) => events.push(`seed ${seed}`),
    settings: (part: object) => events.push(`settings ${JSON.stringify(part)}`),
    reconnect: () => events.push("reconnect"),
    state: () => ({ ready, problem }),
    sampled: { key: "k", kept: 1, missed: 1, problem: null },
    takePicture: async (index: number) => new Blob([String(index)]),
    discardSamples,
    run: (plan: { about: object }, stop: AbortSignal) =>
      new Promise((resolve, reject) => {
        events.push(`run ${JSON.stringify(plan.about)}`);
        stop.addEventListener("abort", () => reject(stop.reason));
        meanwhile();
        const recording = {
          started_unix_ms: performance.timeOrigin + performance.now(),
          ended_ms: 1100,
          captures: [{}, {}],
        };
        setTimeout(() => resolve(recording as unknown as Recording), 1100);
      }),
  };
  const session = {
    phase: { peek: () => phase },
    source: signal(null),
  };
  const work = perform(JOB, {
    session: session as unknown as ViewerSession,
    runner: runner as unknown as Runner,
    shaper: { api, status, connectionError: signal("The shaper is away.") } as unknown as Shaper,
    experiment: "e1",
    stage: (what) => events.push(what),
    signal: cancelling.signal,
  });
  work.catch(() => undefined);
  await vi.advanceTimersByTimeAsync(70_000);
  return work;
}

test("the link is in force before the connection of the run, and the movement begins with its part of the trace", async () => {
  vi.spyOn(Date, "now").mockReturnValue(5);
  const { upload, captures, samples } = await performed();
  expect(events).toEqual([
    "stand",
    "Connecting",
    "Waiting for the first view",
    ...["start", "seek"],
    "seed 7",
    'settings {"mode":"stateless"}',
    "reconnect",
    "Warming up",
    "seek",
    "Playing the movement",
    "seek",
    'run {"experiment":"e1","run":"r","stored":false,"title":"Seen","started_unix_ms":5}',
    "stop",
  ]);
  expect(upload).toMatchObject({ backend: "netem", sampling_problem: "Of 2 samples, 1 could not be stored." });
  expect(upload.link).toHaveLength(1);
  expect(await Promise.all(captures.map((png) => png.text()))).toEqual(["0", "1"]);
  expect(samples).toBe("k");
});

test.each<[string, () => void, string | RegExp]>([
  ["a connection that fails", () => Object.assign(phase, { kind: "failed", message: "No scene." }), "No scene."],
  ["no frame", () => (ready = false), "No frame arrived within 60 s."],
  ["frames unlike those asked for", () => (problem = "No GPU."), "Frames cannot be shown as configured. No GPU."],
  ["a shaper that refuses", () => (refused = true), "There is no trace bus."],
  [
    "a link that another changes",
    () => (meanwhile = () => (status.value = { ...STATUS, trace: "train", time_ms: 1200 })),
    "The link was changed from outside during the run.",
  ],
  [
    "a connection that does not return",
    () => (meanwhile = () => (phase = { kind: "lost" })),
    "The connection was lost during the run and did not return.",
  ],
  ["a shaper that goes away", () => (meanwhile = () => (status.value = null)), "The shaper is away."],
  [
    "models that are given up meanwhile",
    () => (meanwhile = () => (problem = "It took 40 ms.")),
    "Frames cannot be shown as configured. It took 40 ms.",
  ],
])("%s costs the run, and the link is given back", async (_, prepare, sentence) => {
  prepare();
  await expect(performed()).rejects.toThrow(sentence);
  expect(events.at(-1)).toBe("stop");
});

test("a page that is hidden waits, and then gives up", async () => {
  const hidden = vi.spyOn(document, "visibilityState", "get").mockReturnValue("hidden");
  await expect(performed()).rejects.toThrow("The page was hidden");
  hidden.mockRestore();
});

test("a disturbed run leaves no samples", async () => {
  meanwhile = () => cancelling.abort(new RunFailed("cancelled"));
  await expect(performed()).rejects.toThrow("cancelled");
  expect(discardSamples).toHaveBeenCalled();
});

test("a page that is left gives the link back", async () => {
  meanwhile = () => dispatchEvent(new Event("pagehide"));
  await performed();
  expect(events).toContain("abandon");
});
