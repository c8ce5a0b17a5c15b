/** The store of experiments (`docs/store.md`). Every failure is an ApiError with one sentence to show. */

import { ApiError, readProblem } from "../http/problem";
import { storeUnreachable } from "../http/reach";
import type {
  ExperimentCreated,
  ExperimentList,
  ExperimentRequest,
  ExperimentSummary,
  Figures,
  RunRow,
  RunUpload,
  Experiment as StoredExperiment,
} from "../wire/store";
import type { RunFigures } from "./figures";
import { type ExperimentPlan, runsOf } from "./plan";

/** The figures of a run take a moment; in milliseconds. */
const TIMEOUT = 60_000;
/** A run may be large: so much of it is sent at least, in bytes a millisecond. */
const SLOWEST = 125;

export class StoreApi {
  readonly base: string;

  /** `base` is the store's URL, with or without a slash at its end. */
  constructor(base: string) {
    this.base = base.replace(/\/+$/, "");
  }

  /** Begins an experiment; its id. */
  async create(plan: ExperimentPlan): Promise<string> {
    const request: ExperimentRequest = { name: plan.name, plan, planned: runsOf(plan).length };
    const { id } = await this.#json<ExperimentCreated>("experiments", request);
    return id;
  }

  /** Keeps one run. */
  add(id: string, run: RunUpload): Promise<RunRow> {
    return this.#json(`${this.#path(id)}/runs`, run);
  }

  async list(): Promise<readonly ExperimentSummary[]> {
    return (await this.#json<ExperimentList>("experiments")).experiments;
  }

  /** One with its plan and its runs. */
  get(id: string): Promise<StoredExperiment> {
    return this.#json(this.#path(id));
  }

  /** All files of an experiment. */
  zipUrl(id: string): string {
    return `${this.base}/${this.#path(id)}/zip`;
  }

  reportUrl(id: string): string {
    return `${this.base}/${this.#path(id)}/report`;
  }

  #path(id: string): string {
    return `experiments/${encodeURIComponent(id)}`;
  }

  async #json<T>(path: string, content?: object): Promise<T> {
    const body = content && JSON.stringify(content);
    let answer: Response;
    try {
      answer = await fetch(`${this.base}/${path}`, {
        cache: "no-store",
        signal: AbortSignal.timeout(TIMEOUT + (body?.length ?? 0) / SLOWEST),
        ...(body && { method: "POST", body, headers: { "Content-Type": "application/json" } }),
      });
      if (answer.ok) return (await answer.json()) as T;
    } catch {
      throw new ApiError(storeUnreachable(this.base, location.href), true);
    }
    throw new ApiError((await readProblem(answer)).detail, false);
  }
}

/** The figures that the page shows, from all that the store knows. */
export function toRunFigures({
  latencies,
  content_ages,
  frames,
  mean_height,
  rungs,
  received_kbps,
}: Figures): RunFigures {
  return {
    p50: latencies.p50,
    p90: latencies.p90,
    p95: latencies.p95,
    p99: latencies.p99,
    interactive: latencies.share_interactive,
    interactiveFrameLess: latencies.share_frame_less,
    interactiveFrameMore: latencies.share_frame_more,
    contentAge: content_ages.mean,
    newViewsPerSecond: frames.new_views_per_s,
    meanHeight: mean_height,
    switches: rungs.switches,
    received: received_kbps === null ? null : received_kbps * 1000,
  };
}
