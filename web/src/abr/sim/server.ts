/** The render service: one frame at a time is rendered, of those that wait the newest first, and encoding goes on beside it. */
import { RequestProblem } from "../../transport/transport";
import type { Rung, ServerTiming } from "../../wire";
import type { EventLoop } from "./events";
import { normal } from "./random";
import type { Sender, Stream } from "./sender";

export interface Job {
  readonly rung: number;
  /** The answer's bytes came, or some of them. */
  readonly received: (bytes: number) => void;
  /** The header: the whole answer's bytes, and where the time went. */
  readonly answered: (bytes: number, timing: ServerTiming) => void;
  readonly refused: (problem: RequestProblem) => void;
}

export interface ServerOptions {
  readonly ladder: readonly Rung[];
  readonly random: () => number;
  /** Milliseconds to render a frame, and to encode one of the best rung. */
  readonly render: number;
  readonly encode: number;
}

/** How much a frame's size varies with the view (standard deviation), and for how long a view stays alike (ms). */
const SIZE_DEVIATION = 0.12;
const SIZE_MEMORY = 2000;
/** A frame takes this much more or less to render, at most. */
const RENDER_VARIATION = 0.15;

const SUPERSEDED = {
  type: "tigas:superseded",
  title: "Superseded",
  status: 409,
  detail: "A newer request took this one's place.",
} as const;

export class Server {
  readonly #events: EventLoop;
  readonly #sender: Sender;
  readonly #options: ServerOptions;
  #waiting: { readonly job: Job; readonly since: number } | undefined;
  #rendering = false;
  readonly #cancelled = new WeakSet<Job>();
  readonly #streams = new WeakMap<Job, Stream>();
  #richness = 0;
  #richnessAt = 0;

  constructor(events: EventLoop, sender: Sender, options: ServerOptions) {
    this.#events = events;
    this.#sender = sender;
    this.#options = options;
  }

  request(job: Job): void {
    if (this.#cancelled.has(job)) return;
    this.#waiting?.job.refused(new RequestProblem(SUPERSEDED));
    this.#waiting = { job, since: this.#events.now() };
    this.#next();
  }

  cancel(job: Job): void {
    this.#cancelled.add(job);
    if (this.#waiting?.job === job) this.#waiting = undefined;
    const stream = this.#streams.get(job);
    if (stream) this.#sender.cancel(stream);
  }

  #next(): void {
    if (this.#rendering || this.#waiting === undefined) return;
    const { job, since } = this.#waiting;
    const { ladder, random } = this.#options;
    const queue = this.#events.now() - since;
    const render = this.#options.render * (1 + RENDER_VARIATION * (2 * random() - 1));
    const [rung, best] = [ladder[job.rung], ladder[0]];
    const pixels = rung && best ? (rung.width * rung.height) / (best.width * best.height) : 1;
    const encode = this.#options.encode * pixels;
    this.#waiting = undefined;
    this.#rendering = true;
    this.#events.at(this.#events.now() + render, () => {
      this.#rendering = false;
      this.#events.at(this.#events.now() + encode, () => this.#answer(job, { queue, render, encode }));
      this.#next();
    });
  }

  #answer(job: Job, timing: ServerTiming): void {
    if (this.#cancelled.has(job)) return;
    const bytes = Math.round((this.#options.ladder[job.rung]?.expected_kb ?? 0) * 1000 * this.#size());
    const stream: Stream = { remaining: bytes, received: job.received };
    this.#streams.set(job, stream);
    job.answered(bytes, timing);
    this.#sender.send(stream);
  }

  /** How rich in detail the view is, compared with what the ladder expects: a Gaussian process that wanders as views do. */
  #size(): number {
    const now = this.#events.now();
    const kept = Math.exp((this.#richnessAt - now) / SIZE_MEMORY);
    this.#richness = kept * this.#richness + Math.sqrt(1 - kept ** 2) * normal(this.#options.random);
    this.#richnessAt = now;
    return Math.max(0.5, 1 + SIZE_DEVIATION * this.#richness);
  }
}
