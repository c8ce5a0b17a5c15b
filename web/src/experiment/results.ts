/** Outcomes of an experiment's runs, and figures of each controller and mode. Pure. */

import type { Columns } from "../charts/columns";
import { LATENCY_BINS_MS } from "../charts/histogram";
import type { RunUpload } from "../wire/store";
import { type InputLatency, percentile, type RunFigures } from "./figures";
import { conditionLabel, type ExperimentPlan, type PlannedRun } from "./plan";

export interface RunResult {
  readonly run: PlannedRun;
  readonly status: "complete" | "failed" | "cancelled";
  /** Why it failed, or why the store does not have it, in one sentence. */
  readonly problem: string | null;
  readonly figures: RunFigures | null;
  readonly inputLatencies: readonly InputLatency[];
  /** The page was hidden at some time, so that the browser may have held frames back. */
  readonly hidden: boolean;
  /** The complete measurement, until a store has it. */
  readonly unstored: RunUpload | null;
  /** The folder of samples that only this browser has; null without. */
  readonly samples: string | null;
  /** A notice about them, in one sentence. */
  readonly samplesProblem: string | null;
  /** The share of its time in which the store's machine had hardly any processor time left, if that was too often. */
  readonly saturatedShare?: number | null;
}

/** One controller or mode: means over its complete runs. */
export interface ConditionSummary {
  /** The first of its runs. */
  readonly run: PlannedRun;
  readonly runs: number;
  readonly complete: number;
  readonly figures: Readonly<Record<keyof RunFigures, number | null>>;
}

/** One row per controller or mode, in the order in which they ran first. */
export function summarize(results: readonly RunResult[]): ConditionSummary[] {
  return byCondition(results).map((runs) => {
    const complete = runs.flatMap(({ figures }) => figures ?? []);
    const mean = (name: keyof RunFigures) => meanOf(complete.map((figures) => figures[name]));
    return {
      run: runs[0].run,
      runs: runs.length,
      complete: complete.length,
      figures: {
        p50: mean("p50"),
        p90: mean("p90"),
        p95: mean("p95"),
        p99: mean("p99"),
        viewP50: mean("viewP50"),
        viewP95: mean("viewP95"),
        interactive: mean("interactive"),
        interactiveFrameLess: mean("interactiveFrameLess"),
        interactiveFrameMore: mean("interactiveFrameMore"),
        contentAge: mean("contentAge"),
        newViewsPerSecond: mean("newViewsPerSecond"),
        meanHeight: mean("meanHeight"),
        switches: mean("switches"),
        received: mean("received"),
      },
    };
  });
}

/** Percent of each condition's inputs that were on the screen within a time (ms); all runs of a condition together. */
export function cumulativeDistribution(results: readonly RunResult[]): Columns {
  const columns = byCondition(results).map((runs) => {
    const latencies = runs.flatMap(({ inputLatencies }) => inputLatencies.map(({ latency }) => latency));
    if (latencies.length === 0) return LATENCY_BINS_MS.map(() => null);
    return LATENCY_BINS_MS.map(
      (limit) => (100 * latencies.filter((latency) => latency <= limit).length) / latencies.length,
    );
  });
  return [LATENCY_BINS_MS, ...columns];
}

/** Width of a bin of `overTime`, in milliseconds. */
const BIN = 500;

/** The median latency (ms) of each condition's inputs over the time of the movement (s), in bins of half a second. */
export function medianOverTime(results: readonly RunResult[]): Columns {
  const conditions = byCondition(results).map((runs) =>
    grouped(
      runs.flatMap(({ inputLatencies }) => inputLatencies),
      binOf,
    ),
  );
  const last = Math.max(-1, ...conditions.flatMap((bins) => [...bins.keys()]));
  const bins = Array.from({ length: last + 1 }, (_, bin) => bin);
  const medians = conditions.map((found) =>
    bins.map((bin) => percentile(found.get(bin)?.map(({ latency }) => latency) ?? [], 0.5)),
  );
  return [bins.map((bin) => ((bin + 0.5) * BIN) / 1000), ...medians];
}

/** The download without a store: one file with every measurement that is not stored elsewhere. */
export function toJson(plan: ExperimentPlan, created: string, results: readonly RunResult[]): string {
  const runs = results.map(({ run, status, problem, unstored }) => ({
    status,
    problem,
    ...(unstored ?? { configuration: run, recording: null, link: [], scene_bytes: null }),
  }));
  return JSON.stringify({ name: plan.name, created, source: "page", plan, runs });
}

/** By controller or mode, in the order in which they ran first. */
function byCondition(results: readonly RunResult[]): NonEmpty<RunResult>[] {
  return [...grouped(results, ({ run }) => conditionLabel(run)).values()];
}

type NonEmpty<T> = [T, ...T[]];

function grouped<K, V>(values: readonly V[], keyOf: (value: V) => K): Map<K, NonEmpty<V>> {
  const groups = new Map<K, NonEmpty<V>>();
  for (const value of values) {
    const key = keyOf(value);
    const group = groups.get(key);
    if (group) group.push(value);
    else groups.set(key, [value]);
  }
  return groups;
}

function binOf({ at }: InputLatency): number {
  return Math.max(0, Math.floor(at / BIN));
}

function meanOf(values: readonly (number | null)[]): number | null {
  const known = values.flatMap((value) => value ?? []);
  // A percentile without an answer has no mean with the others.
  return known.length === 0 || known.length < values.length ? null : known.reduce((a, b) => a + b) / known.length;
}
