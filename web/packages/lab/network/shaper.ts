/** Client of one shaper: its traces, its live link and the user's actions, until disposed of. */
import { signal } from "@preact/signals";
import { shaperObstacle } from "#client/http/obstacles";
import { ApiError } from "#client/http/problem";
import type { ShaperStatus, TracePoints, TraceSummary } from "#client/wire/shaper";
import { append, type Column, noColumns } from "#viewer/charts/history";
import type { Stats } from "#viewer/stateless/stats";
import { ShaperApi } from "./api";

/** Rates towards the client in Mbit/s: target, delivered. */
export function rates({ down }: ShaperStatus): Column {
  return [down.target_kbps / 1000, down.delivered_kbps / 1000];
}

/** The newest frame's size in kB and the round trip in ms; undefined if no frame was shown since `shown`. */
export function frames({ frame, roundTrip, shown }: Stats, shownBefore: number): Column {
  return frame && shown !== shownBefore ? [frame.bytes / 1000, roundTrip] : [null, null];
}

/** A step function's outline as an SVG path in a box, with the highest value at the top. */
export function stepPath(
  times: readonly number[],
  values: readonly number[],
  end: number,
  box: [number, number],
): string {
  const [width, height] = box;
  const top = Math.max(...values, Number.MIN_VALUE);
  const x = (time: number) => ((time / end) * width).toFixed(1);
  const y = (value: number) => (height - (value / top) * height).toFixed(1);
  const steps = values.map((value, i) => `${i === 0 ? "M0 " : "V"}${y(value)}H${x(times[i + 1] ?? end)}`);
  return steps.join("");
}

/** EventSource reconnects automatically, except after an error response; then we do, after this many milliseconds. */
const RETRY = 5000;

export class Shaper {
  readonly api: ShaperApi;
  readonly traces = signal<readonly TraceSummary[]>([]);
  /** Traces to draw, by name, filled as they arrive. */
  readonly plots = signal<ReadonlyMap<string, TracePoints>>(new Map());
  /** Null while the link's state is unknown. */
  readonly status = signal<ShaperStatus | null>(null);
  readonly rates = signal(noColumns(2));
  /** Why the link's state is unknown, in one sentence. */
  readonly connectionError = signal<string | null>(null);
  /** Reason why the user's last action failed. */
  readonly actionError = signal<string | null>(null);
  readonly #plotted: boolean;
  #events: EventSource | undefined;
  #retry: ReturnType<typeof setTimeout> | undefined;
  #disposed = false;

  /** `page` is the page's own URL, `now` a clock in milliseconds, `plotted` whether `plots` are wanted. */
  constructor(base: string, page: string, { plotted = false } = {}) {
    this.#plotted = plotted;
    this.api = new ShaperApi(base);
    this.connectionError.value = shaperObstacle(base, page);
    if (this.connectionError.value === null) this.#watch();
  }

  /** Performs a user's action, or reports the reason for its failure. */
  async act(ask: (api: ShaperApi) => Promise<ShaperStatus>): Promise<void> {
    try {
      this.status.value = await ask(this.api);
      this.actionError.value = null;
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      this.actionError.value = error.message;
    }
  }

  /** Uploads a trace; returns its name on the shaper, or null after reporting a failure. */
  async upload(file: File): Promise<string | null> {
    try {
      const { name } = await this.api.upload(file);
      this.actionError.value = null;
      await this.#list();
      return name;
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      this.actionError.value = error.message;
      return null;
    }
  }

  dispose(): void {
    this.#disposed = true;
    this.#events?.close();
    clearTimeout(this.#retry);
  }

  #watch(): void {
    const events = new EventSource(`${this.api.base}/events`);
    this.#events = events;
    events.onopen = () => {
      this.connectionError.value = null;
      void this.#list();
    };
    events.onmessage = ({ data }: MessageEvent<string>) => {
      const status = JSON.parse(data) as ShaperStatus;
      this.status.value = status;
      this.rates.value = append(this.rates.value, performance.now() / 1000, rates(status));
    };
    events.onerror = () => {
      this.status.value = null;
      this.connectionError.value = this.api.silence;
      if (events.readyState !== EventSource.CLOSED) return;
      this.#retry = setTimeout(() => this.#watch(), RETRY);
    };
  }

  async #list(): Promise<void> {
    try {
      this.traces.value = (await this.api.traces()).traces;
      for (const { name, error } of this.#plotted ? this.traces.value : []) {
        if (this.#disposed) return;
        if (error) continue;
        const points = await this.api.trace(name);
        this.plots.value = new Map(this.plots.value).set(name, points);
      }
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      this.actionError.value = error.message;
    }
  }
}
