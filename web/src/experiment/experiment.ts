/**
 * One experiment of the page: its runs in sequence, their outcomes, and progress. A failed run is marked, and the
 * others continue. Measuring, storing and time are dependencies.
 */

import { computed, signal } from "@preact/signals";
import { ApiError } from "../http/problem";
import { ShaperError } from "../network/api";
import { type Sampled, whyFewer } from "../samples/sampler";
import type { RunUpload } from "../wire/store";
import { RunFailed } from "./errors";
import { figures, inputLatencies } from "./figures";
import { type ExperimentPlan, type PlannedRun, runsOf, timeFor } from "./plan";
import type { RunResult } from "./results";
import type { RunPlace } from "./sample-upload";
import { type StoreApi, toRunFigures } from "./store-api";

export interface Progress {
  /** Counted from one. */
  readonly run: number;
  readonly of: number;
  readonly planned: PlannedRun;
  /** The present step. */
  readonly stage: string;
  /** When the first run began and the last will have ended, on the page's clock. */
  readonly startedAt: number;
  readonly endsAt: number;
}

/** The missing part of a stored experiment. */
export interface ResumedExperiment {
  /** The store's name for it. */
  readonly id: string;
  /** The runs that are missing there. */
  readonly runs: readonly PlannedRun[];
}

export interface ExperimentDependencies {
  /** Makes a run; rejects with the failure, or with the reason of `signal`. */
  readonly measure: (run: PlannedRun, stage: (what: string) => void, signal: AbortSignal) => Promise<RunUpload>;
  readonly store: Pick<StoreApi, "create" | "add"> | null;
  /** Outcome of the last run's samples; null if none were requested. */
  readonly sampled: () => Sampled | null;
  /** Brings samples to a run of the store; rejects with an ApiError, or with the reason of `signal`. */
  readonly uploadSamples: (
    key: string,
    place: RunPlace,
    progress: (sent: number, of: number) => void,
    signal: AbortSignal,
  ) => Promise<void>;
  /** In milliseconds. */
  readonly now: () => number;
}

const HERE_ONLY = "Its samples are in this browser only.";

export class Experiment {
  readonly plan: ExperimentPlan;
  /** ISO 8601. */
  readonly created: string;
  /** Null before the first run and after the last. */
  readonly progress = signal<Progress | null>(null);
  readonly results = signal<readonly RunResult[]>([]);
  /** The store's name for it. */
  readonly id = signal<string | null>(null);
  /** Why the store does not keep it, in one sentence. */
  readonly notice = signal<string | null>(null);
  /** Everything not in a store was saved as a file. */
  readonly saved = signal(false);
  /** It would be lost with the page. */
  readonly unsaved = computed(() => !this.saved.value && this.results.value.some(({ unstored }) => unstored !== null));
  readonly #runs: readonly PlannedRun[];
  readonly #dependencies: ExperimentDependencies;
  readonly #cancelled = new AbortController();
  /** Time of each run in addition to its warm-up and movement, in milliseconds. */
  readonly #overheads: number[] = [];

  /** All runs of the plan, unless some of them were made before. */
  constructor(
    plan: ExperimentPlan,
    created: string,
    dependencies: ExperimentDependencies,
    resumed?: ResumedExperiment,
  ) {
    this.plan = plan;
    this.created = created;
    this.#runs = resumed?.runs ?? runsOf(plan);
    this.id.value = resumed?.id ?? null;
    this.#dependencies = dependencies;
  }

  get cancelled(): boolean {
    return this.#cancelled.signal.aborted;
  }

  /** Ends the present run at once, and makes no other. */
  cancel(): void {
    this.#cancelled.abort();
  }

  /** Makes all runs; rejects never. */
  async conduct(): Promise<void> {
    const runs = this.#runs;
    const { now } = this.#dependencies;
    const startedAt = now();
    const stageOf = (index: number) => {
      const endsAt = now() + this.#timeFor(runs.length - index);
      return (stage: string) => {
        const planned = runs[index];
        if (planned) this.progress.value = { run: index + 1, of: runs.length, planned, stage, startedAt, endsAt };
      };
    };
    stageOf(0)("Begins");
    await this.#begin();
    for (const [index, run] of runs.entries()) {
      if (this.cancelled) break;
      const begun = now();
      const result = await this.#make(run, stageOf(index));
      this.results.value = [...this.results.value, result];
      if (result.status === "complete") this.#overheads.push(now() - begun - timeFor(this.plan, 1, 0));
    }
    this.progress.value = null;
  }

  /** Uploads everything missing in the store again; never rejects. */
  async store(): Promise<void> {
    await this.#begin();
    for (const [index, result] of this.results.peek().entries()) {
      if (result.unstored === null) continue;
      const { place, ...stored } = await this.#stored(result.unstored);
      const samples = place === null ? {} : { samplesProblem: null, ...(await this.#uploaded(result.samples, place)) };
      this.results.value = this.results.peek().with(index, { ...result, ...stored, ...samples });
    }
  }

  async #begin(): Promise<void> {
    const { store } = this.#dependencies;
    if (store === null || this.id.value !== null) return;
    try {
      this.id.value = await store.create(this.plan);
      this.notice.value = null;
    } catch (error) {
      this.notice.value = `${sentence(error)} The results stay in this page.`;
    }
  }

  async #make(run: PlannedRun, stage: (what: string) => void): Promise<RunResult> {
    let measured: RunUpload;
    let shown: Pick<RunResult, "inputLatencies" | "hidden" | "figures">;
    try {
      measured = await this.#dependencies.measure(run, stage, this.#cancelled.signal);
      const { recording } = measured;
      shown = { inputLatencies: inputLatencies(recording), hidden: recording.hidden, figures: figures(recording) };
    } catch (error) {
      const nothing = {
        run,
        figures: null,
        inputLatencies: [],
        hidden: false,
        unstored: null,
        samples: null,
        samplesProblem: null,
      };
      if (this.cancelled) return { ...nothing, status: "cancelled", problem: "It was cancelled before its end." };
      return { ...nothing, status: "failed", problem: sentence(error) };
    }
    stage("Stores the run");
    const { place, ...stored } = await this.#stored(measured);
    const sampled = this.#dependencies.sampled();
    const key = sampled?.key ?? null;
    const samples = place === null ? { samples: key } : await this.#uploaded(key, place, stage);
    return {
      run,
      status: "complete",
      ...shown,
      ...stored,
      samplesProblem: sampled && (whyFewer(sampled) ?? (place === null ? HERE_ONLY : null)),
      ...samples,
    };
  }

  /** The remaining samples after an upload to the store. */
  async #uploaded(
    key: string | null,
    place: RunPlace,
    stage: (what: string) => void = () => undefined,
  ): Promise<Pick<RunResult, "samples"> & Partial<RunResult>> {
    if (key === null) return { samples: null };
    const told = (sent: number, of: number) => stage(`Uploads samples, ${megabytes(sent)} of ${megabytes(of)} MB`);
    try {
      await this.#dependencies.uploadSamples(key, place, told, this.#cancelled.signal);
      return { samples: null };
    } catch (error) {
      const why = this.cancelled ? "The upload was cancelled." : sentence(error);
      return { samples: key, samplesProblem: `${HERE_ONLY} ${why}` };
    }
  }

  /** The store's figures, if it takes the run; otherwise the run stays here. */
  async #stored(
    measured: RunUpload,
  ): Promise<Pick<RunResult, "problem" | "unstored"> & Partial<RunResult> & { readonly place: RunPlace | null }> {
    const { store } = this.#dependencies;
    const experiment = this.id.value;
    if (store === null || experiment === null) return { problem: null, unstored: measured, place: null };
    try {
      const { figures: known, folder: run, saturated_share } = await store.add(experiment, measured);
      const place = { experiment, run };
      const told = { saturatedShare: saturated_share ?? null, ...(known && { figures: toRunFigures(known) }) };
      return { problem: null, unstored: null, place, ...told };
    } catch (error) {
      return { problem: `It is not stored: ${sentence(error)}`, unstored: measured, place: null };
    }
  }

  #timeFor(runs: number): number {
    const seen = this.#overheads;
    return timeFor(this.plan, runs, seen.length ? seen.reduce((a, b) => a + b) / seen.length : undefined);
  }
}

function megabytes(bytes: number): string {
  return (bytes / 1e6).toFixed(1);
}

function sentence(error: unknown): string {
  if (error instanceof RunFailed || error instanceof ShaperError || error instanceof ApiError) return error.message;
  return `The page failed: ${error instanceof Error ? error.message : error}`.replace(/\.?$/, ".");
}
