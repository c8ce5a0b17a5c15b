/** The store of experiments (`docs/store.md`). Every failure is an ApiError with one sentence to show. */
import { ApiError } from "../state/api";
import type { ExperimentCreated, ExperimentList, ExperimentSummary, Figures, RunRow } from "../store-wire";
import { readProblem } from "../transport/fetch";
import type { RunFigures } from "./figures";
import type { ExperimentPlan } from "./plan";
import type { Measured } from "./results";

/** A run may be large, and its figures take a moment; so do an experiment's ZIP and its report. In milliseconds. */
const TIMEOUT = 60_000;

export class StoreApi {
  readonly base: string;

  /** `base` is the store's URL, with or without a slash at its end. */
  constructor(base: string) {
    this.base = base.replace(/\/+$/, "");
  }

  /** Begins an experiment; its id. */
  async create(plan: ExperimentPlan): Promise<string> {
    const { id } = await this.#json<ExperimentCreated>("experiments", { name: plan.name, plan });
    return id;
  }

  /** Keeps one run. */
  add(id: string, measured: Measured): Promise<RunRow> {
    return this.#json(`${this.#path(id)}/runs`, measured);
  }

  async list(): Promise<readonly ExperimentSummary[]> {
    return (await this.#json<ExperimentList>("experiments")).experiments;
  }

  /** All files of an experiment. */
  async zip(id: string): Promise<Blob> {
    return this.#read(`${this.#path(id)}/zip`, (answer) => answer.blob());
  }

  zipUrl(id: string): string {
    return `${this.base}/${this.#path(id)}/zip`;
  }

  reportUrl(id: string): string {
    return `${this.base}/${this.#path(id)}/report`;
  }

  #path(id: string): string {
    return `experiments/${encodeURIComponent(id)}`;
  }

  #json<T>(path: string, body?: object): Promise<T> {
    return this.#read(path, (answer) => answer.json() as Promise<T>, body);
  }

  async #read<T>(path: string, read: (answer: Response) => Promise<T>, body?: object): Promise<T> {
    let answer: Response;
    try {
      answer = await fetch(`${this.base}/${path}`, {
        cache: "no-store",
        signal: AbortSignal.timeout(TIMEOUT),
        ...(body && { method: "POST", body: JSON.stringify(body), headers: { "Content-Type": "application/json" } }),
      });
      if (answer.ok) return await read(answer);
    } catch {
      // Browsers do not tell a page that it was refused for its origin.
      throw new ApiError(`The store at ${this.base} does not answer, or does not allow this page.`, true);
    }
    throw new ApiError((await readProblem(answer)).detail, false);
  }
}

/** The figures that the page shows, from all that the store knows. */
export function shownFigures({ latencies, frames, mean_height, rungs, received_kbps }: Figures): RunFigures {
  return {
    p50: latencies.p50,
    p95: latencies.p95,
    interactive: latencies.share_interactive,
    framesPerSecond: frames.per_s,
    meanHeight: mean_height,
    switches: rungs.switches,
    received: received_kbps === null ? null : received_kbps * 1000,
  };
}
