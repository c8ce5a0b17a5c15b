import { expect, test } from "vitest";
import { LATENCY_BINS_MS } from "../charts/histogram";
import { experimentPlan } from "./fake-plan";
import type { RunFigures } from "./figures";
import { runsOf } from "./plan";
import { cumulativeDistribution, medianOverTime, type RunResult, summarize, toJson } from "./results";

const PLAN = experimentPlan({ modes: ["stateless", "dash-typical"], repeats: 2 });
const FIGURES: RunFigures = {
  p50: 40,
  p90: 90,
  p95: 90,
  p99: 90,
  viewP50: 40,
  viewP95: 90,
  interactive: 0.9,
  interactiveFrameLess: 0.9,
  interactiveFrameMore: 0.9,
  contentAge: 50,
  newViewsPerSecond: 30,
  meanHeight: 720,
  switches: 2,
  received: 1e6,
};
const [first, dash, second] = runsOf(PLAN);
const result = (run: typeof first, more: Partial<RunResult> = {}): RunResult => {
  if (run === undefined) throw new Error("the plan has no such run");
  return {
    run,
    status: "complete",
    problem: null,
    figures: FIGURES,
    inputLatencies: [],
    hidden: false,
    unstored: null,
    samples: null,
    samplesProblem: null,
    ...more,
  };
};

test("one row per controller and mode: the mean of its complete runs, and how many there are", () => {
  const rows = summarize([
    result(first),
    result(dash, { status: "failed", problem: "No frame came.", figures: null }),
    result(second, { figures: { ...FIGURES, p50: 60, p95: null } }),
  ]);
  expect(rows.map(({ run, runs, complete }) => [run.mode, runs, complete])).toEqual([
    ["stateless", 2, 2],
    ["dash-typical", 1, 0],
  ]);
  expect(rows[0]?.figures).toEqual({ ...FIGURES, p50: 50, p95: null });
  expect(rows[1]?.figures.p50).toBeNull();
});

test("the distribution counts inputs that were never answered among all", () => {
  const inputLatencies = [20, 30, 3000, Number.POSITIVE_INFINITY].map((latency) => ({ at: 0, latency }));
  const [limits, shares] = cumulativeDistribution([result(first, { inputLatencies })]);
  expect(limits).toBe(LATENCY_BINS_MS);
  const within = (limit: number) => shares?.[LATENCY_BINS_MS.findLastIndex((bin) => bin <= limit)];
  expect([within(15), within(100), within(4900)]).toEqual([0, 50, 75]);
});

test("the latency over time is the median of half a second; nothing where nothing moved", () => {
  const inputLatencies = [
    { at: 0, latency: 10 },
    { at: 100, latency: 50 },
    { at: 400, latency: 20 },
    { at: 1200, latency: Number.POSITIVE_INFINITY },
    { at: 1600, latency: 70 },
  ];
  expect(medianOverTime([result(first, { inputLatencies }), result(dash)])).toEqual([
    [0.25, 0.75, 1.25, 1.75],
    [20, null, null, 70],
    [null, null, null, null],
  ]);
});

test("nothing measured is nothing to plot", () => {
  expect(medianOverTime([])).toEqual([[]]);
  expect(cumulativeDistribution([])).toEqual([LATENCY_BINS_MS]);
});

test("what is downloaded holds the plan, every run, and all that no store has", () => {
  const failed = result(first, { status: "failed", problem: "No frame came.", figures: null });
  const file = JSON.parse(toJson(PLAN, "2026-01-01T00:00:00Z", [failed]));
  expect(file).toMatchObject({ name: "two", plan: { movement: "stroll" }, source: "page" });
  expect(file.runs).toEqual([
    {
      status: "failed",
      problem: "No frame came.",
      configuration: failed.run,
      recording: null,
      link: [],
      scene_bytes: null,
    },
  ]);
});
