import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { ApiError } from "#client/http/problem";
import type { NextRun, RunJob, RunRow, RunUpload } from "#client/wire/store";
import { Conductor } from "./conductor";
import { RunFailed } from "./errors";
import type { Performed } from "./perform";
import type { StoreApi } from "./store-api";

const { uploadSamples } = vi.hoisted(() => ({ uploadSamples: vi.fn(async (_: object) => undefined) }));
vi.mock("./sample-upload", () => ({ uploadSamples }));

const NOTHING: NextRun = { job: null, planned: 2, missing: 0, remaining_s: 0, wait: false, problem: null };
const AWAY = new ApiError("The store is away.", true);
const job = (run: string): NextRun => ({
  ...NOTHING,
  job: { run, title: run.toUpperCase() } as RunJob,
  missing: 1,
  remaining_s: 10,
});
const performed = (more: Partial<Performed> = {}): Performed => ({
  upload: { recording: {} as NonNullable<RunUpload["recording"]> },
  captures: [],
  samples: null,
  ...more,
});

/** Answers of the store in turn, by request; errors are thrown. */
let answers: { next: (NextRun | Error)[]; add: (Partial<RunRow> | Error)[] };
let asked: unknown[][];
let perform: (job: RunJob, stage: (what: string) => void, signal: AbortSignal) => Promise<Performed>;
let conductor: Conductor;

function answer<T>(from: (T | Error)[], otherwise: T): T {
  const given = from.shift() ?? otherwise;
  if (given instanceof Error) throw given;
  return given;
}

beforeEach(() => {
  vi.useFakeTimers();
  vi.clearAllMocks();
  answers = { next: [], add: [] };
  asked = [];
  perform = async () => performed();
  const store = {
    next: async (_: string, { begin, allow_changes }: { begin: boolean; allow_changes: boolean }) => {
      asked.push(["next", begin, allow_changes]);
      return answer(answers.next, NOTHING);
    },
    add: async (_: string, run: string, { problem }: RunUpload) => {
      asked.push(["add", run, problem ?? null]);
      return answer(answers.add, problem ? { status: "failed", problem } : { status: "running", problem: null });
    },
    addCapture: async (_: string, run: string, index: number) => void asked.push(["capture", run, index]),
    complete: async (_: string, run: string) => {
      asked.push(["complete", run]);
      return { status: "complete", problem: null };
    },
    release: () => void asked.push(["release"]),
  };
  conductor = new Conductor("e1", {
    store: store as unknown as StoreApi,
    perform: (...all) => perform(...all),
    page: "page",
  });
});

const isAdd = ([kind]: unknown[]) => kind === "add";

afterEach(() => {
  vi.useRealTimers();
});

async function conducted(allowChanges = false) {
  const done = conductor.conduct(allowChanges);
  await vi.runAllTimersAsync();
  await done;
  return conductor.ending.value;
}

test("runs are performed, uploaded with their captures, and completed until there is none", async () => {
  answers.next = [job("a"), job("b")];
  perform = async ({ run }) => performed({ captures: run === "a" ? [new Blob(), new Blob()] : [] });
  expect(await conducted()).toEqual({ problem: null, refused: false, missing: 0, sampled: false });
  expect(asked).toEqual([
    ["next", true, false],
    ["add", "a", null],
    ["capture", "a", 0],
    ["capture", "a", 1],
    ["complete", "a"],
    ["next", false, false],
    ["add", "b", null],
    ["complete", "b"],
    ["next", false, false],
  ]);
  expect(conductor.notices.value).toEqual([]);
});

test("a run that fails is reported, and the others go on", async () => {
  answers.next = [job("a"), job("b")];
  perform = async ({ run }) => {
    if (run === "a") throw new RunFailed("The connection was lost during the run.");
    throw new TypeError("x is undefined");
  };
  await conducted();
  expect(asked.filter(isAdd)).toEqual([
    ["add", "a", "The connection was lost during the run."],
    ["add", "b", "The page failed: x is undefined."],
  ]);
  expect(conductor.notices.value).toEqual([
    "A: The connection was lost during the run.",
    "B: The page failed: x is undefined.",
  ]);
});

test("a store that is away is asked until it answers, so that no run is lost", async () => {
  answers.next = [AWAY, job("a")];
  answers.add = [AWAY, AWAY];
  await conducted();
  expect(asked.filter(isAdd)).toHaveLength(3);
  expect(asked.filter(([kind, begin]) => kind === "next" && begin === true)).toHaveLength(2);
  expect(conductor.ending.value?.problem).toBeNull();
});

test("a run that the store refuses is a failed one", async () => {
  answers.next = [job("a")];
  answers.add = [new ApiError("It is no recording.", false)];
  await conducted();
  expect(asked.slice(1, 3)).toEqual([
    ["add", "a", null],
    ["add", "a", "The store rejected the run. It is no recording."],
  ]);
  expect(conductor.notices.value).toEqual(["A: The store rejected the run. It is no recording."]);
});

test("it waits while other pages perform the other runs", async () => {
  answers.next = [
    { ...NOTHING, missing: 1, wait: true },
    { ...NOTHING, missing: 1, wait: true },
  ];
  await conducted();
  expect(asked).toHaveLength(3);
});

test("what ends an experiment early is said", async () => {
  answers.next = [{ ...NOTHING, missing: 3, problem: "5 runs in a row failed." }];
  expect(await conducted()).toMatchObject({ problem: "5 runs in a row failed.", missing: 3, refused: false });
});

test("other versions are refused, and taken when a person says so", async () => {
  answers.next = [new ApiError("There is another commit.", false, "tigas:versions-changed")];
  expect(await conducted()).toMatchObject({ problem: "There is another commit.", refused: true });
  await conducted(true);
  expect(asked.at(-1)).toEqual(["next", true, true]);
});

test("cancelling ends the present run, which is given back", async () => {
  answers.next = [job("a"), job("b")];
  perform = (_, __, signal) =>
    new Promise((_resolve, reject) => {
      signal.addEventListener("abort", () => reject(signal.reason));
      setTimeout(() => conductor.cancel(), 10);
    });
  expect(await conducted()).toMatchObject({ problem: "The experiment was cancelled.", missing: 1 });
  expect(asked[1]).toEqual(["release"]);
  expect(asked.some(isAdd)).toBe(false);
});

test("samples follow their run; what stays in the browser is said", async () => {
  answers.next = [job("a"), job("b")];
  perform = async ({ run }) => performed({ samples: run, upload: { ...performed().upload, sampling_problem: "Few." } });
  uploadSamples.mockResolvedValueOnce(undefined).mockRejectedValueOnce(AWAY);
  expect(await conducted()).toMatchObject({ sampled: true });
  expect(uploadSamples.mock.calls).toMatchObject([[{ key: "a", stored: true }], [{ key: "b", stored: true }]]);
  expect(conductor.notices.value).toEqual([
    "A: Few.",
    "B: Few.",
    "B: Its samples are only in this browser. The store is away.",
  ]);
});
