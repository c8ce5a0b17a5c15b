import { beforeEach, expect, test, vi } from "vitest";
import { ApiError } from "../state/api";
import { RunFailed } from "./errors";
import { Experiment, type Hands } from "./experiment";
import type { ExperimentPlan, PlannedRun } from "./plan";
import type { Measured } from "./results";

const PLAN: ExperimentPlan = {
  name: "two",
  scene: "courtyard",
  movement: "stroll",
  network: { trace: null, rtt_ms: null },
  modes: ["stateless"],
  profiles: ["latency", "budget"],
  repeats: 2,
  duration_s: 10,
  warm_up_s: 2,
};

function measured(run: PlannedRun): Measured {
  const recording = {
    scene: run.scene,
    mode: "stateless" as const,
    transport: "fetch",
    user_agent: "",
    lens: { width: 640, height: 360, fx: 300, fy: 300, cx: 320, cy: 180 },
    started_unix_ms: 0,
    duration_ms: 10_000,
    ended_ms: 10_100,
    complete: true,
    hidden: run.repeat === 1,
    inputs: [{ at: 5, pose: 1, position: [0, 0, 0], quaternion: [0, 0, 0, 1] }],
    frames: [{ side: "stateless" as const, at: 45, pose: 1, latencies: [40], rung: 0, width: 640, height: 360 }],
    captures: [],
    traffic: [],
  };
  return { configuration: { ...run, width: 640, height: 360 }, recording, link: [], scene_bytes: 1 };
}

let time: number;
let made: PlannedRun[];
let hands: Hands & { measure: Hands["measure"] };

beforeEach(() => {
  time = 0;
  made = [];
  hands = {
    measure: async (run, stage) => {
      stage("Plays the movement");
      made.push(run);
      time += 13_000;
      return measured(run);
    },
    store: null,
    now: () => time,
  };
});

const conducted = async (more: Partial<Hands> = {}): Promise<Experiment> => {
  const experiment = new Experiment(PLAN, "2026-01-01T00:00:00Z", { ...hands, ...more });
  await experiment.conduct();
  return experiment;
};

test("makes all runs, keeps them where there is no store, and marks those of a hidden page", async () => {
  const { results, progress } = await conducted();
  expect(results.value.map(({ status, hidden, unstored }) => [status, hidden, unstored !== null])).toEqual([
    ["complete", false, true],
    ["complete", false, true],
    ["complete", true, true],
    ["complete", true, true],
  ]);
  expect(results.value[0]?.figures?.p95).toBe(40);
  expect(progress.value).toBeNull();
});

test("a run that fails is marked with its sentence, and the others go on", async () => {
  const measure: Hands["measure"] = async (run, stage, signal) => {
    if (run.profile === "latency" && run.repeat === 0) throw new RunFailed("No frame came.");
    if (run.profile === "budget" && run.repeat === 0) throw new TypeError("x is not a function");
    return hands.measure(run, stage, signal);
  };
  const { results } = await conducted({ measure });
  expect(results.value.map(({ status, problem }) => [status, problem])).toEqual([
    ["failed", "No frame came."],
    ["failed", "The page failed: x is not a function."],
    ["complete", null],
    ["complete", null],
  ]);
});

test("cancelling ends the present run, keeps what was finished, and makes no other", async () => {
  const experiment = new Experiment(PLAN, "", {
    ...hands,
    measure: async (run, stage, signal) => {
      if (made.length === 1) {
        experiment.cancel();
        signal.throwIfAborted();
      }
      return hands.measure(run, stage, signal);
    },
  });
  await experiment.conduct();
  expect(experiment.cancelled).toBe(true);
  expect(experiment.results.value.map(({ status }) => status)).toEqual(["complete", "cancelled"]);
});

test("the store's figures are shown, and what it has is not kept here", async () => {
  const figures = {
    latencies: { inputs: 1, unanswered: 0, p50: 41, p95: 42, p99: 43, share_interactive: 0.9 },
    frames: { shown: 1, per_s: 25, new_views: 1, new_views_per_s: 25 },
    rungs: { share: {}, switches: 3 },
    mean_height: 360,
    received_kbps: 1200,
  };
  const add = vi.fn(async () => ({ figures }) as never);
  const { id, results } = await conducted({ store: { create: async () => "e1", add } });
  expect(id.value).toBe("e1");
  expect(add).toHaveBeenCalledTimes(4);
  expect(results.value[3]).toMatchObject({ unstored: null, answers: [{ at: 5, latency: 40 }] });
  expect(results.value[3]?.figures).toEqual({
    p50: 41,
    p95: 42,
    interactive: 0.9,
    framesPerSecond: 25,
    meanHeight: 360,
    switches: 3,
    received: 1.2e6,
  });
});

test("a store that refuses a run loses nothing", async () => {
  let calls = 0;
  const add = async () => {
    if (calls++ === 0) throw new ApiError("The disk is full.", false);
    return { figures: null } as never;
  };
  const { results } = await conducted({ store: { create: async () => "e1", add } });
  expect(results.value.map(({ problem, unstored }) => [problem, unstored !== null])).toEqual([
    ["It is not stored: The disk is full.", true],
    [null, false],
    [null, false],
    [null, false],
  ]);
  expect(results.value[0]?.figures?.p50).toBe(40);
});

test("a store that does not answer stops nothing", async () => {
  const create = async () => {
    throw new ApiError("The store does not answer.", true);
  };
  const add = vi.fn();
  const { notice, results } = await conducted({ store: { create, add } });
  expect(notice.value).toBe("The store does not answer. The results stay in this page.");
  expect(add).not.toHaveBeenCalled();
  expect(results.value).toHaveLength(4);
});

test("the time left follows what runs were seen to take", async () => {
  const ends: (number | undefined)[] = [];
  const experiment = new Experiment(PLAN, "", {
    ...hands,
    measure: async (run, stage, signal) => {
      stage("Connects");
      ends.push(experiment.progress.value?.endsAt);
      return hands.measure(run, stage, signal);
    },
  });
  await experiment.conduct();
  expect(ends).toEqual([4 * 17_000, 4 * 13_000, 4 * 13_000, 4 * 13_000]);
});
