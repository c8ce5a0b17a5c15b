/**
 * Makes the runs that the store hands out for an experiment, one after the other, and uploads them. A failed run is
 * reported, and the others continue. The store and the making of a run are dependencies.
 */
import { signal } from "@preact/signals";
import { sleep } from "#client/async/retry";
import { ApiError } from "#client/http/problem";
import type { NextRun, RunJob, RunUpload } from "#client/wire/store";
import { RunFailed } from "./errors";
import type { Performed } from "./perform";
import { uploadSamples } from "./sample-upload";
import type { StoreApi } from "./store-api";

export interface Progress extends Pick<NextRun, "planned" | "missing" | "remaining_s"> {
  /** The current run's display name; null before the first. */
  readonly title: string | null;
  readonly stage: string;
}

/** How it ended: `problem` is null if all runs were tried. */
export interface Ending {
  readonly problem: string | null;
  /** Whether it was refused because the complete runs were made with other versions. */
  readonly refused: boolean;
  readonly missing: number;
  /** Whether samples were uploaded to the store. */
  readonly sampled: boolean;
}

export interface ConductorDependencies {
  readonly store: StoreApi;
  readonly perform: (job: RunJob, stage: (what: string) => void, signal: AbortSignal) => Promise<Performed>;
  /** Random identifier of the page. */
  readonly page: string;
}

/** Polling interval, in milliseconds, while other pages make the other runs and while the store is unreachable. */
const ASK_EVERY = 2000;
/** Maximum length of a problem that the store accepts. */
const LONGEST_PROBLEM = 1000;

export class Conductor {
  readonly progress = signal<Progress>({ planned: 0, missing: 0, remaining_s: 0, title: null, stage: "Starting" });
  /** Null while it is in progress. */
  readonly ending = signal<Ending | null>(null);
  /** Notices about single runs, in order. */
  readonly notices = signal<readonly string[]>([]);
  readonly #id: string;
  readonly #dependencies: ConductorDependencies;
  readonly #cancelled = new AbortController();
  #sampled = false;

  constructor(id: string, dependencies: ConductorDependencies) {
    this.#id = id;
    this.#dependencies = dependencies;
  }

  /** Ends the current run at once, and starts no other. */
  cancel(): void {
    this.#cancelled.abort();
    this.release();
  }

  /** Releases the current run, even while the page unloads. */
  release(): void {
    const { store, page } = this.#dependencies;
    store.release(this.#id, page);
  }

  /** Makes all runs; never rejects. */
  async conduct(allowChanges = false): Promise<void> {
    const { signal } = this.#cancelled;
    try {
      let asked = { begin: true, allow_changes: allowChanges };
      for (;;) {
        const { job, ...next } = await this.#patiently(() => this.#next(asked));
        asked = { begin: false, allow_changes: false };
        this.progress.value = { ...next, title: job?.title ?? null, stage: job ? "" : "Waiting for other pages" };
        if (job !== null) await this.#make(job);
        else if (next.wait) await sleep(ASK_EVERY, signal);
        else {
          this.#end(next.problem);
          return;
        }
      }
    } catch (error) {
      const refused = error instanceof ApiError && error.type === "tigas:versions-changed";
      this.#end(signal.aborted ? "The experiment was cancelled." : sentence(error), refused);
      this.release();
    }
  }

  #end(problem: string | null, refused = false): void {
    const { missing } = this.progress.value;
    this.ending.value = { problem, refused, missing, sampled: this.#sampled };
  }

  #next(asked: { readonly begin: boolean; readonly allow_changes: boolean }): Promise<NextRun> {
    const { store, page } = this.#dependencies;
    return store.next(this.#id, { page, ...asked }, this.#cancelled.signal);
  }

  async #make(job: RunJob): Promise<void> {
    const stage = (what: string) => {
      this.progress.value = { ...this.progress.value, stage: what };
    };
    const note = (what: string) => {
      this.notices.value = [...this.notices.value, `${job.title}: ${what}`];
    };
    const { signal } = this.#cancelled;
    let performed: Performed;
    try {
      performed = await this.#dependencies.perform(job, stage, signal);
    } catch (error) {
      if (signal.aborted) throw error;
      performed = { upload: { problem: sentence(error).slice(0, LONGEST_PROBLEM) }, captures: [], samples: null };
    }
    stage("Saving the run");
    const problem = await this.#kept(job, performed);
    if (problem !== null) note(problem);
    if (performed.upload.sampling_problem) note(performed.upload.sampling_problem);
    if (performed.samples !== null) await this.#samples(performed.samples, stage, note);
  }

  /** Uploads a run; returns why it failed or was refused, in one sentence, or null. */
  async #kept({ run }: RunJob, { upload, captures }: Performed): Promise<string | null> {
    const { store } = this.#dependencies;
    const add = (what: RunUpload) => this.#patiently(() => store.add(this.#id, run, what));
    try {
      let row = await add(upload);
      if (row.status === "failed") return row.problem;
      for (const [index, png] of captures.entries()) {
        await this.#patiently(() => store.addCapture(this.#id, run, index, png));
      }
      row = await this.#patiently(() => store.complete(this.#id, run));
      return row.problem;
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      const problem = `The store rejected the run. ${error.message}`;
      if (upload.recording) await add({ problem: problem.slice(0, LONGEST_PROBLEM) }).catch(ignoreRefusal);
      return problem;
    }
  }

  async #samples(key: string, stage: (what: string) => void, note: (what: string) => void): Promise<void> {
    const { store } = this.#dependencies;
    const { signal } = this.#cancelled;
    const progress = (sent: number, of: number) =>
      stage(`Uploading samples, ${megabytes(sent)} of ${megabytes(of)} MB`);
    try {
      await uploadSamples({ key, stored: true, store, progress, signal });
      this.#sampled = true;
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      note(`Its samples are only in this browser. ${error.message}`);
    }
  }

  /** Retries until the store answers. */
  async #patiently<T>(ask: () => Promise<T>): Promise<T> {
    const { signal } = this.#cancelled;
    for (;;) {
      try {
        return await ask();
      } catch (error) {
        signal.throwIfAborted();
        if (!(error instanceof ApiError && error.unreachable)) throw error;
        this.progress.value = { ...this.progress.value, stage: `${error.message} Trying again…` };
        await sleep(ASK_EVERY, signal);
      }
    }
  }
}

/** Another page may have completed the run meanwhile. */
function ignoreRefusal(error: unknown): void {
  if (!(error instanceof ApiError)) throw error;
}

function megabytes(bytes: number): string {
  return (bytes / 1e6).toFixed(1);
}

function sentence(error: unknown): string {
  if (error instanceof RunFailed || error instanceof ApiError) return error.message;
  return `The page failed: ${error instanceof Error ? error.message : error}`.replace(/\.?$/, ".");
}
