/** The shaper's HTTP interface. Every failure is an ApiError with one sentence to show. */
import { type AskOptions, ask } from "#client/http/problem";
import type {
  LinkSetting,
  ShaperStatus,
  StartRequest,
  TraceList,
  TracePoints,
  TraceSummary,
} from "#client/wire/shaper";

/** In milliseconds. */
const TIMEOUT = 5000;
const UPLOAD_TIMEOUT = 120_000;

export class ShaperApi {
  readonly base: string;

  /** `base` is the shaper's URL, with or without a trailing slash. */
  constructor(base: string) {
    this.base = base.replace(/\/+$/, "");
  }

  traces(): Promise<TraceList> {
    return this.#call("traces");
  }

  trace(name: string): Promise<TracePoints> {
    return this.#call(`traces/${encodeURIComponent(name)}`);
  }

  /** Uploads a trace in any format that `tigas trace import` reads; large ones take a while. */
  upload(file: File): Promise<TraceSummary> {
    return this.#ask(`traces?name=${encodeURIComponent(file.name)}`, {
      method: "POST",
      body: file,
      timeout: UPLOAD_TIMEOUT,
    });
  }

  start(request: StartRequest): Promise<ShaperStatus> {
    return this.#call("start", request);
  }

  pause(): Promise<ShaperStatus> {
    return this.#call("pause", {});
  }

  resume(): Promise<ShaperStatus> {
    return this.#call("resume", {});
  }

  /** Seeks to a position in the trace, in milliseconds. */
  seek(position_ms: number): Promise<ShaperStatus> {
    return this.#call("seek", { position_ms });
  }

  stop(): Promise<ShaperStatus> {
    return this.#call("stop", {});
  }

  /** Stops the link while the page unloads, without waiting for an answer. */
  abandon(): void {
    navigator.sendBeacon(`${this.base}/stop`, "{}");
  }

  loop(loop: boolean): Promise<ShaperStatus> {
    return this.#call("loop", { loop });
  }

  link(setting: LinkSetting): Promise<ShaperStatus> {
    return this.#call("link", setting);
  }

  /** One sentence on an unreachable shaper; browsers do not report refused origins. */
  get silence(): string {
    return `The shaper at ${this.base} is not responding, or does not allow this page.`;
  }

  #call<T>(path: string, body?: object): Promise<T> {
    const headers = { "Content-Type": "application/json" };
    return this.#ask(path, body ? { method: "POST", body: JSON.stringify(body), headers } : {});
  }

  #ask<T>(path: string, request: AskOptions): Promise<T> {
    const read = (answer: Response) => answer.json() as Promise<T>;
    return ask(`${this.base}/${path}`, read, () => this.silence, { timeout: TIMEOUT, ...request });
  }
}
