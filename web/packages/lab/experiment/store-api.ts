/** The store of experiments (`docs/experiments.md`). Every failure is an ApiError with one sentence to show. */

import { storeUnreachable } from "#client/http/obstacles";
import { type AskOptions, ask } from "#client/http/problem";
import type {
  ExperimentCreated,
  ExperimentList,
  ExperimentRequest,
  ExperimentSummary,
  Materialisation,
  NextRequest,
  NextRun,
  PlanSummary,
  RunRow,
  RunUpload,
  Sample,
  SampleList,
  Experiment as StoredExperiment,
  UploadedSamples,
} from "#client/wire/store";

/** A scene may have to be loaded, and pictures compared with ground truth; in milliseconds. */
const TIMEOUT = 60_000;
const LONG_TIMEOUT = 600_000;
/** Minimum rate of uploading a run, which may be large, in bytes per millisecond. */
const SLOWEST = 125;

export class StoreApi {
  readonly base: string;

  /** `base` is the store's URL, with or without a trailing slash. */
  constructor(base: string) {
    this.base = base.replace(/\/+$/, "");
  }

  /** Expands an experiment's file, without storing anything. */
  summary(request: ExperimentRequest, signal: AbortSignal): Promise<PlanSummary> {
    return this.#json("plans", { method: "POST", content: request, signal });
  }

  /** Begins an experiment; returns its id. */
  async create(request: ExperimentRequest): Promise<string> {
    return (await this.#json<ExperimentCreated>("experiments", { method: "POST", content: request })).id;
  }

  /** Reserves a run. */
  next(id: string, asked: NextRequest, signal: AbortSignal): Promise<NextRun> {
    return this.#json(`${this.#path(id)}/next`, { method: "POST", content: asked, signal, timeout: LONG_TIMEOUT });
  }

  /** Gives up a page's reserved run, even while the page unloads. */
  release(id: string, page: string): void {
    const url = `${this.base}/${this.#path(id)}/pages/${page}`;
    void fetch(url, { method: "DELETE", keepalive: true }).catch(() => undefined); // the store frees the run after a while
  }

  /** Stores one run, which is incomplete until `complete`. */
  add(id: string, run: string, upload: RunUpload): Promise<RunRow> {
    return this.#json(this.#run(id, run), { method: "PUT", content: upload, timeout: LONG_TIMEOUT });
  }

  async addCapture(id: string, run: string, index: number, png: Blob): Promise<void> {
    const name = `${String(index).padStart(4, "0")}.png`;
    await this.#blob(`${this.#run(id, run)}/captures/${name}`, { method: "PUT", body: png });
  }

  /** Completes a run once all its captures are uploaded. */
  complete(id: string, run: string): Promise<RunRow> {
    return this.#json(`${this.#run(id, run)}/complete`, { method: "POST", timeout: LONG_TIMEOUT });
  }

  /** The pictures of a run's samples that the store has. */
  uploadedSamples(id: string, run: string): Promise<UploadedSamples> {
    return this.#json(`${this.#run(id, run)}/uploaded-samples`);
  }

  async addPicture(id: string, run: string, name: string, picture: Blob, signal: AbortSignal): Promise<void> {
    await this.#blob(`${this.#run(id, run)}/samples/${name}`, { method: "PUT", body: picture, signal });
  }

  /** Reports all samples, once their pictures are uploaded. */
  async completeSamples(id: string, run: string, samples: readonly Sample[]): Promise<void> {
    await this.#blob(`${this.#run(id, run)}/samples`, { method: "PUT", content: { samples } });
  }

  samples(id: string, run: string): Promise<SampleList> {
    return this.#json(`${this.#run(id, run)}/samples`);
  }

  picture(id: string, run: string, name: string): Promise<Blob> {
    return this.#blob(`${this.#run(id, run)}/samples/${encodeURIComponent(name)}`);
  }

  /** Progress of rendering the samples again; POST starts or continues it, DELETE stops it and keeps the results so far. */
  materialisation(id: string, method: "GET" | "POST" | "DELETE" = "GET"): Promise<Materialisation> {
    return this.#json(`${this.#path(id)}/materialise`, { method });
  }

  async list(): Promise<readonly ExperimentSummary[]> {
    return (await this.#json<ExperimentList>("experiments")).experiments;
  }

  get(id: string): Promise<StoredExperiment> {
    return this.#json(this.#path(id));
  }

  async remove(id: string): Promise<void> {
    await this.#blob(this.#path(id), { method: "DELETE" });
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

  #run(id: string, run: string): string {
    return `${this.#path(id)}/runs/${encodeURIComponent(run)}`;
  }

  #json<T>(path: string, request: Asked = {}): Promise<T> {
    return this.#ask(path, (answer) => answer.json(), request);
  }

  #blob(path: string, request: Asked = {}): Promise<Blob> {
    return this.#ask(path, (answer) => answer.blob(), request);
  }

  #ask<T>(path: string, read: (answer: Response) => Promise<T>, { content, ...request }: Asked): Promise<T> {
    const headers = { "Content-Type": "application/json" };
    const asked: AskOptions = content ? { ...request, body: JSON.stringify(content), headers } : request;
    const bytes = typeof asked.body === "string" ? asked.body.length : (request.body?.size ?? 0);
    const timeout = (request.timeout ?? TIMEOUT) + bytes / SLOWEST;
    return ask(`${this.base}/${path}`, read, () => storeUnreachable(this.base, location.href), { ...asked, timeout });
  }
}

interface Asked extends AskOptions {
  readonly body?: Blob;
  /** Sent as JSON. */
  readonly content?: object;
}
