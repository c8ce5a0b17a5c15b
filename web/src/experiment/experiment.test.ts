import { beforeEach, expect, test, vi } from "vitest";
import { ApiError } from "../http/problem";
import type { Sampled } from "../samples/sampler";
import type { Recording, RunUpload } from "../wire/store";
import { RunFailed } from "./errors";
import { Experiment, type ExperimentDependencies } from "./experiment";
import { experimentPlan } from "./fake-plan";
import { type PlannedRun, runsOf } from "./plan";
import type { StoreApi } from "./store-api";

const PLAN = experimentPlan({ profiles: ["latency", "budget"], repeats: 2 });

function measured(run: PlannedRun): RunUpload {
  const recording: Recording = {
    scene: run.scene,
    mode: "stateless",
    transport: "fetch",
    dash: null,
    user_agent: "",
    lens: { width: 640, height: 360, fx: 300, fy: 300, cx: 320, cy: 180 },
    started_unix_ms: 0,
    duration_ms: 10_000,
    ended_ms: 10_100,
    complete: true,
    hidden: run.repeat === 1,
    inputs: [{ at: 5, pose: 1, position: [0, 0, 0], quaternion: [0, 0, 0, 1] }],
    frames: [{ side: "stateless", at: 45, pose: 1, latencies: [40], rung: 0, width: 640, height: 360 }],
    replies: [],
    captures: [],
    traffic: [],
  };
  return { configuration: { ...run, width: 640, height: 360 }, recording, link: [], scene_bytes: 1 };
}

let time: number;
let made: PlannedRun[];
let dependencies: ExperimentDependencies & { measure: ExperimentDependencies["measure"] };

beforeEach(() => {
  time = 0;
  made = [];
  dependencies = {
    measure: async (run, stage) => {
      stage("Plays the movement");
      made.push(run);
      time += 13_000;
      return measured(run);
    },
    store: null,
    sampled: () => null,
    uploadSamples: async () => undefined,
    now: () => time,
  };
});

const conducted = async (more: Partial<ExperimentDependencies> = {}): Promise<Experiment> => {
  const experiment = new Experiment(PLAN, "2026-01-01T00:00:00Z", { ...dependencies, ...more });
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
  const measure: ExperimentDependencies["measure"] = async (run, stage, signal) => {
    if (run.profile === "latency" && run.repeat === 0) throw new RunFailed("No frame came.");
    if (run.profile === "budget" && run.repeat === 0) throw new TypeError("x is not a function");
    return dependencies.measure(run, stage, signal);
  };
  const { results } = await conducted({ measure });
  expect(results.value.map(({ status, problem }) => [status, problem])).toEqual([
    ["failed", "No frame came."],
    ["failed", "The page failed: x is not a function."],
    ["complete", null],
    ["complete", null],
  ]);
});

test("a recording that cannot be evaluated fails its run alone", async () => {
  const measure: ExperimentDependencies["measure"] = async (run, stage, signal) => {
    const whole = await dependencies.measure(run, stage, signal);
    return made.length === 1 ? { ...whole, recording: { ...whole.recording, frames: null as never } } : whole;
  };
  const { results } = await conducted({ measure });
  expect(results.value.map(({ status }) => status)).toEqual(["failed", "complete", "complete", "complete"]);
});

test("cancelling ends the present run, keeps what was finished, and makes no other", async () => {
  const experiment = new Experiment(PLAN, "", {
    ...dependencies,
    measure: async (run, stage, signal) => {
      if (made.length === 1) {
        experiment.cancel();
        signal.throwIfAborted();
      }
      return dependencies.measure(run, stage, signal);
    },
  });
  await experiment.conduct();
  expect(experiment.cancelled).toBe(true);
  expect(experiment.results.value.map(({ status }) => status)).toEqual(["complete", "cancelled"]);
});

test("the store's figures are shown, and what it has is not kept here", async () => {
  const figures = {
    latencies: {
      inputs: 1,
      unanswered: 0,
      p50: 41,
      p90: 41.5,
      p95: 42,
      p99: 43,
      share_interactive: 0.9,
      share_frame_less: 0.8,
      share_frame_more: 1,
    },
    view_latencies: { unanswered: 0, p50: 16, p90: 17, p95: 18, p99: 19 },
    content_ages: { mean: 55, p50: 50, p95: 60 },
    frames: { shown: 5, per_s: 25, new_views: 4, new_views_per_s: 20 },
    rungs: { share: {}, switches: 3 },
    mean_height: 360,
    received_kbps: 1200,
  };
  const add = vi.fn(async () => ({ figures }) as never);
  const { id, results } = await conducted({ store: { create: async () => "e1", add } });
  expect(id.value).toBe("e1");
  expect(add).toHaveBeenCalledTimes(4);
  expect(results.value[3]).toMatchObject({ unstored: null, inputLatencies: [{ at: 5, latency: 40 }] });
  expect(results.value[3]?.figures).toEqual({
    p50: 41,
    p90: 41.5,
    p95: 42,
    p99: 43,
    viewP50: 16,
    viewP95: 18,
    interactive: 0.9,
    interactiveFrameLess: 0.8,
    interactiveFrameMore: 1,
    contentAge: 55,
    newViewsPerSecond: 20,
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

test("what the store does not have is offered to it once more", async () => {
  let away = true;
  const create = async () => {
    if (away) throw new ApiError("The store does not answer.", true);
    return "e1";
  };
  const added: PlannedRun[] = [];
  const add: StoreApi["add"] = async (_, { configuration }) => {
    if (added.length === 3) throw new ApiError("The disk is full.", false);
    added.push(configuration as PlannedRun);
    return { figures: null } as never;
  };
  const experiment = await conducted({ store: { create, add } });
  expect(experiment.unsaved.value).toBe(true);
  away = false;
  await experiment.store();
  expect([experiment.id.value, experiment.notice.value]).toEqual(["e1", null]);
  expect(experiment.results.value.map(({ problem, unstored }) => [problem, unstored !== null])).toEqual([
    [null, false],
    [null, false],
    [null, false],
    ["It is not stored: The disk is full.", true],
  ]);
  added.length = 0;
  await experiment.store();
  expect(added).toEqual([expect.objectContaining({ profile: "budget", repeat: 1 })]);
  expect(experiment.results.value.map(({ problem }) => problem)).toEqual([null, null, null, null]);
  expect(experiment.unsaved.value).toBe(false);
});

const SAMPLED: Sampled = { key: "k", kept: 3, missed: 0, problem: null };
const AGAIN = { create: async () => "e1", add: async () => ({ figures: null, folder: "a-run" }) as never };

test("a run's samples follow it to the store, before the next run", async () => {
  const stages: string[] = [];
  const events: string[] = [];
  const experiment = new Experiment(PLAN, "", {
    ...dependencies,
    store: AGAIN,
    measure: async (run, stage, signal) => {
      events.push("run");
      return dependencies.measure(run, stage, signal);
    },
    sampled: () => SAMPLED,
    uploadSamples: async (key, { experiment: id, run }, progress) => {
      progress(1_500_000, 3_000_000);
      stages.push(experiment.progress.value?.stage ?? "");
      events.push(`upload ${key} to ${id}/${run}`);
    },
  });
  await experiment.conduct();
  expect(events.slice(0, 4)).toEqual(["run", "upload k to e1/a-run", "run", "upload k to e1/a-run"]);
  expect(stages[0]).toBe("Uploads samples, 1.5 of 3.0 MB");
  expect(experiment.results.value[0]).toMatchObject({ samples: null, samplesProblem: null });
});

test("samples that cannot be uploaded stay in the browser, and the experiment goes on", async () => {
  const uploadSamples = () => Promise.reject(new ApiError("The disk is full.", false));
  const { results } = await conducted({ store: AGAIN, sampled: () => SAMPLED, uploadSamples });
  expect(results.value).toHaveLength(4);
  expect(results.value[0]).toMatchObject({
    status: "complete",
    unstored: null,
    samples: "k",
    samplesProblem: "Its samples are in this browser only. The disk is full.",
  });
});

test("samples of a run that is stored later are uploaded then", async () => {
  let away = true;
  const add: StoreApi["add"] = async (...run) => {
    if (away) throw new ApiError("The disk is full.", false);
    return (AGAIN.add as StoreApi["add"])(...run);
  };
  const uploadSamples = vi.fn(async () => undefined);
  const experiment = await conducted({ store: { ...AGAIN, add }, sampled: () => SAMPLED, uploadSamples });
  expect(uploadSamples).not.toHaveBeenCalled();
  expect(experiment.results.value[0]).toMatchObject({
    samples: "k",
    samplesProblem: "Its samples are in this browser only.",
  });
  away = false;
  await experiment.store();
  expect(uploadSamples).toHaveBeenCalledTimes(4);
  expect(experiment.results.value[0]).toMatchObject({ samples: null, samplesProblem: null });
});

test.each([
  [{ ...SAMPLED, missed: 2 }, "Of 5 samples, 2 could not be kept."],
  [
    { ...SAMPLED, key: null, problem: "There are no files. Nothing was sampled." },
    "There are no files. Nothing was sampled.",
  ],
])("what is not sampled is told", async (sampled, sentence) => {
  const { results } = await conducted({ store: AGAIN, sampled: () => sampled });
  expect(results.value[0]?.samplesProblem).toBe(sentence);
});

test("an experiment that the store has gets the runs that are missing there, and no others", async () => {
  const missing = runsOf(PLAN).slice(2);
  const create = vi.fn();
  const add = vi.fn(async () => ({ figures: null }) as never);
  const experiment = new Experiment(PLAN, "", { ...dependencies, store: { create, add } }, { id: "e1", runs: missing });
  await experiment.conduct();
  expect(made).toEqual(missing);
  expect(create).not.toHaveBeenCalled();
  expect(add.mock.calls.map(([id]: unknown[]) => id)).toEqual(["e1", "e1"]);
});

test("the time left follows what runs were seen to take", async () => {
  const ends: (number | undefined)[] = [];
  const experiment = new Experiment(PLAN, "", {
    ...dependencies,
    measure: async (run, stage, signal) => {
      stage("Connects");
      ends.push(experiment.progress.value?.endsAt);
      return dependencies.measure(run, stage, signal);
    },
  });
  await experiment.conduct();
  expect(ends).toEqual([4 * 17_000, 4 * 13_000, 4 * 13_000, 4 * 13_000]);
});
