/** The store of experiments (`docs/experiments.md`). Every failure is an ApiError with one sentence to show. */

import { ApiError, readProblem } from "../http/problem";
import { storeUnreachable } from "../http/reach";
import type {
  ExperimentCreated,
  ExperimentList,
  ExperimentRequest,
  ExperimentSummary,
  Figures,
  InterruptedRun,
  Materialisation,
  RunRow,
  RunUpload,
  Sample,
  SampleList,
  Experiment as StoredExperiment,
  UploadedSamples,
} from "../wire/store";
import type { RunFigures } from "./figures";
import { type ExperimentPlan, runsOf } from "./plan";

/** The figures of a run take a moment; in milliseconds. */
const TIMEOUT = 60_000;
/** Minimum rate of uploading a run, which may be large, in bytes per millisecond. */
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

  /** A place for the samples of a run that was never ended. */
  addInterrupted(id: string, run: InterruptedRun): Promise<RunRow> {
    return this.#json(`${this.#path(id)}/interrupted-runs`, run);
  }

  /** Which pictures of a run's samples it has. */
  uploadedSamples(id: string, run: string): Promise<UploadedSamples> {
    return this.#json(`${this.#run(id, run)}/uploaded-samples`);
  }

  async addPicture(id: string, run: string, name: string, picture: Blob, signal: AbortSignal): Promise<void> {
    await this.#ask(`${this.#run(id, run)}/samples/${name}`, { method: "PUT", body: picture }, picture.size, signal);
  }

  /** Says which samples there are, once all of their pictures are. */
  async completeSamples(id: string, run: string, samples: readonly Sample[]): Promise<void> {
    const body = JSON.stringify({ samples });
    const headers = { "Content-Type": "application/json" };
    await this.#ask(`${this.#run(id, run)}/samples`, { method: "PUT", body, headers }, body.length);
  }

  /** The samples of a run, in the order of time. */
  samples(id: string, run: string): Promise<SampleList> {
    return this.#json(`${this.#run(id, run)}/samples`);
  }

  picture(id: string, run: string, name: string): Promise<Blob> {
    return this.#ask(`${this.#run(id, run)}/samples/${encodeURIComponent(name)}`, {});
  }

  /** How far rendering the samples again is. */
  materialisation(id: string): Promise<Materialisation> {
    return this.#materialise(id, "GET");
  }

  /** Begins to render them again, or goes on. */
  materialise(id: string): Promise<Materialisation> {
    return this.#materialise(id, "POST");
  }

  /** Existing parts are kept. */
  stopMaterialising(id: string): Promise<Materialisation> {
    return this.#materialise(id, "DELETE");
  }

  async list(): Promise<readonly ExperimentSummary[]> {
    return (await this.#json<ExperimentList>("experiments")).experiments;
  }

  /** One with its plan and its runs. */
  get(id: string): Promise<StoredExperiment> {
    return this.#json(this.#path(id));
  }

  /** With all of its files. */
  async remove(id: string): Promise<void> {
    await this.#ask(this.#path(id), { method: "DELETE" });
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

  #run(id: string, run: string): string {
    return `${this.#path(id)}/runs/${encodeURIComponent(run)}`;
  }

  async #json<T>(path: string, content?: object): Promise<T> {
    const body = content && JSON.stringify(content);
    const headers = { "Content-Type": "application/json" };
    const answer = await this.#ask(path, body ? { method: "POST", body, headers } : {}, body?.length ?? 0);
    return JSON.parse(await answer.text()) as T;
  }

  async #materialise(id: string, method: "GET" | "POST" | "DELETE"): Promise<Materialisation> {
    const answer = await this.#ask(`${this.#path(id)}/materialise`, { method });
    return JSON.parse(await answer.text()) as Materialisation;
  }

  /** The response's body; `bytes` are sent. Also rejects with the reason of `cancelled`. */
  async #ask(path: string, request: RequestInit, bytes = 0, cancelled?: AbortSignal): Promise<Blob> {
    const late = AbortSignal.timeout(TIMEOUT + bytes / SLOWEST);
    const signal = cancelled ? AbortSignal.any([cancelled, late]) : late;
    let answer: Response;
    try {
      answer = await fetch(`${this.base}/${path}`, { cache: "no-store", signal, ...request });
      if (answer.ok) return await answer.blob();
    } catch {
      cancelled?.throwIfAborted();
      throw new ApiError(storeUnreachable(this.base, location.href), true);
    }
    throw new ApiError((await readProblem(answer)).detail, false);
  }
}

/** The figures that the page shows, from all that the store knows. */
export function toRunFigures({
  latencies,
  view_latencies,
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
    viewP50: view_latencies.p50,
    viewP95: view_latencies.p95,
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
