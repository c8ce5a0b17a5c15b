/**
 * Number of requests to keep in flight: enough to cover the round trip, the server's work and the animation frame that
 * the next request may have to wait for, so that the frame rate does not fall with the round trip. More would only
 * queue.
 *
 *     limit = ceil((base + service + animation frame) / interval)
 *
 * `interval` is the time between requests, equal to that of the slowest stage, which is thereby always busy. A server
 * that renders a viewer's newest request first may get a view with every animation frame: an outdated view is dropped
 * before it is rendered. To keep a slow server from being flooded with views that it never renders, `service` counts
 * for at most two animation frames there. Other servers answer in order, and requests beyond their capacity would only
 * wait.
 *
 * `base` is the minimum time that a frame spends outside the server (network, transmission, decoding). Anything above
 * it is our own queue on the link, which a larger limit would only lengthen. A minimum never rises, so if no frame has
 * come close to it for some time, the pipeline drains once (limit 1) and measures it anew.
 */
import type { FrameClock } from "#client/abr/frame-clock";

/** Keeps to the request rate of a busy server, by skipping animation frames between requests. */
export class RequestPace {
  /** Time between requests, in milliseconds; 0 if the server does not announce one. */
  #interval = 0;
  /** Earliest time of the next request, on the page's clock. */
  #next = Number.NEGATIVE_INFINITY;

  /** Interval announced by the newest answer; null for one request per display frame. */
  told(requestsPerS: number | null): void {
    this.#interval = requestsPerS === null ? 0 : 1000 / requestsPerS;
  }

  allows(now: number): boolean {
    return this.#interval === 0 || now >= this.#next;
  }

  /** Records a request; if it had to wait for an animation frame, the next ones are not delayed. */
  sent(now: number): void {
    this.#next = Math.max(this.#next, now - this.#interval) + this.#interval;
  }
}

/** Times of one frame, from its request to the decoded picture. */
export interface FrameTimes {
  /** From sending the request to the decoded frame, less all time in the server, in milliseconds. */
  readonly overhead: number;
  /** Rendering and encoding, in milliseconds. */
  readonly render: number;
  readonly encode: number;
  /** Time of the frame's bytes on the link, in milliseconds; 0 if unknown. */
  readonly transmission: number;
  /** Whether nothing else was in flight when it was sent. */
  readonly alone: boolean;
}

const MIN = 2;
const MAX = 32;
/** A base that no frame came close to during this much activity (milliseconds) is out of date. */
const BASE_MAX_AGE = 5000;
/** Weight of the newest frame in the averages. */
const ALPHA = 0.2;

export class InFlightLimit {
  #base: number | undefined;
  #baseAt = 0;
  #observedAt = 0;
  #service = 0;
  #interval = 0;
  readonly #overtaking: boolean;
  readonly #clock: Pick<FrameClock, "interval">;

  /** `overtaking` says whether the server renders the newest request first; `clock` is the display's. */
  constructor(overtaking: boolean, clock: Pick<FrameClock, "interval">) {
    this.#overtaking = overtaking;
    this.#clock = clock;
  }

  observe({ overhead, render, encode, transmission, alone }: FrameTimes, now: number): void {
    const inOrder = this.#overtaking ? 0 : Math.max(render, encode);
    const interval = Math.max(this.#clock.interval, transmission, inOrder);
    const first = this.#base === undefined;
    this.#service = first ? render + encode : mix(this.#service, render + encode);
    this.#interval = first ? interval : mix(this.#interval, interval);
    this.#observedAt = now;
    if (this.#base === undefined || alone) {
      this.#base = overhead;
      this.#baseAt = now;
    } else if (overhead <= this.#base * 1.25 + 4) {
      this.#base = Math.min(this.#base, overhead);
      this.#baseAt = now;
    }
  }

  get limit(): number {
    if (this.#base === undefined || this.#observedAt - this.#baseAt > BASE_MAX_AGE) return 1;
    const animationFrame = this.#clock.interval;
    const service = this.#overtaking ? Math.min(this.#service, 2 * animationFrame) : this.#service;
    const depth = Math.ceil((this.#base + service + animationFrame) / this.#interval);
    return Math.min(MAX, Math.max(MIN, depth));
  }
}

function mix(average: number, value: number): number {
  return average + ALPHA * (value - average);
}
