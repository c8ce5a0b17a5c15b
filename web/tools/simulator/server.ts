/**
 * The render service: one frame is rendered while the previous one is encoded. The newest waiting request goes first,
 * within the service's limit per viewer; an additional one displaces the oldest.
 */
import { RequestProblem } from "#client/transport/transport";
import type { ServerTiming } from "#client/wire/render";
import type { Endpoints } from "./endpoints";
import type { EventLoop } from "./events";
import type { Sender, Stream } from "./sender";

export interface Job {
  /** Requests are numbered in the order in which they were made. */
  readonly number: number;
  readonly rung: number;
  /** Called when bytes of the answer arrive. */
  readonly received: (bytes: number) => void;
  /** Called with the header: the whole answer's bytes, and the breakdown of its time. */
  readonly answered: (bytes: number, timing: ServerTiming) => void;
  readonly refused: (problem: RequestProblem) => void;
}

interface Rendered {
  readonly job: Job;
  readonly queue: number;
  readonly render: number;
  readonly since: number;
}

/** The service's QUEUE_DEPTH, and the CPU rasteriser's frames in flight. */
const DEPTH = 4;
const IMAGES = 2;
/** Bytes of an answer before its image: a frame's header. */
const HEADER = 170;

const SUPERSEDED = {
  type: "tigas:superseded",
  title: "Superseded",
  status: 409,
  detail: "The request was superseded.",
} as const;

export class Server {
  readonly #events: EventLoop;
  readonly #sender: Sender;
  readonly #endpoints: Endpoints;
  /** Waiting requests, oldest first. */
  #waiting: { readonly job: Job; readonly since: number }[] = [];
  #rendering = false;
  #rendered: Rendered[] = [];
  #encoding = false;
  #images = IMAGES;
  readonly #cancelled = new WeakSet<Job>();
  readonly #streams = new WeakMap<Job, Stream>();

  constructor(events: EventLoop, sender: Sender, endpoints: Endpoints) {
    this.#events = events;
    this.#sender = sender;
    this.#endpoints = endpoints;
  }

  request(job: Job): void {
    if (this.#cancelled.has(job)) return;
    this.#waiting.push({ job, since: this.#events.now() });
    if (this.#waiting.length > DEPTH) this.#waiting.shift()?.job.refused(new RequestProblem(SUPERSEDED));
    this.#render();
  }

  cancel(job: Job): void {
    this.#cancelled.add(job);
    this.#waiting = this.#waiting.filter((waiting) => waiting.job !== job);
    const stream = this.#streams.get(job);
    if (stream) this.#sender.cancel(stream);
  }

  #render(): void {
    if (this.#rendering || this.#images === 0) return;
    const next = this.#waiting.pop();
    if (next === undefined) return;
    const { job, since } = next;
    const queue = this.#events.now() - since;
    const render = this.#endpoints.render(job.rung);
    this.#rendering = true;
    this.#images--;
    this.#events.at(this.#events.now() + render, () => {
      this.#rendering = false;
      this.#rendered.push({ job, queue, render, since: this.#events.now() });
      this.#encode();
      this.#render();
    });
  }

  #encode(): void {
    if (this.#encoding) return;
    const next = this.#rendered.shift();
    if (next === undefined) return;
    const { job, render, since } = next;
    const queue = next.queue + this.#events.now() - since;
    const encode = this.#endpoints.encode(job.rung);
    this.#encoding = true;
    this.#events.at(this.#events.now() + encode, () => {
      this.#encoding = false;
      this.#images++;
      this.#answer(job, { queue, render, encode });
      this.#encode();
      this.#render();
    });
  }

  #answer(job: Job, timing: ServerTiming): void {
    if (this.#cancelled.has(job)) return;
    const bytes = HEADER + this.#endpoints.bytes(job.rung, this.#events.now());
    const stream: Stream = { number: job.number, remaining: bytes, received: job.received };
    this.#streams.set(job, stream);
    job.answered(bytes, timing);
    this.#sender.send(stream);
  }
}
