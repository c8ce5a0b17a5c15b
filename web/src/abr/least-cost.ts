/**
 * What controllers have in common that know what a frame of each rung costs: the rung that costs least, with smooth changes.
 *
 * Down at once and as far as needed; up one rung, when it has been possible for a while. An upgrade that had to be taken back
 * soon makes the next one wait twice as long. Where frames wait on the link although none should, it goes down, too.
 *
 *     link(ℓ) = j + (S(k) / r − j) · S(ℓ) / S(k)
 *     interval(ℓ) = max(f, link(ℓ), stage(ℓ))
 *
 * `S` is what frames of a rung take, `k` the rung in use, `r` the link's throughput, `stage` what they take in the server's
 * slowest stage, `f` an animation frame. Jitter `j` makes a frame's packets come apart by as much whether they are two or
 * twenty: it must not be scaled with a frame's size.
 */
import type { Rung } from "../wire/render";
import { type Controller, type Observation, responseTime, serverTime } from "./controller";
import { FrameClock } from "./frame-clock";
import { LinkDelay } from "./link-delay";
import { ServerTimes } from "./server-times";
import { FrameSizes } from "./sizes";

/** Where the time of a rung's frames goes, in milliseconds. */
export interface FrameTimes {
  /** In the server, waiting included. */
  readonly server: number;
  /** On the link. */
  readonly link: number;
  /** From one frame to the next. */
  readonly interval: number;
  /** What is alike for all rungs: the way there and back, with the queue, and the page. */
  readonly trip: number;
}

/** Frames that wait for more than so many animation frames have a queue before them. */
const QUEUE = 2;
/** Jitter makes up at most this much of what frames seem to take on the link. */
const MOST_JITTER = 0.75;
/** A rung is judged by its own frames: it is not left before so many have come. */
const JUDGED = 5;
/** An upgrade waits until it has been possible for so long, in milliseconds; at most MAX_HOLD after failures. */
const MIN_HOLD = 500;
const MAX_HOLD = 8000;
/** An upgrade that is taken back within this many milliseconds has failed. */
const PROVEN = 1000;
/** A frame waits for its request, for decoding and for the screen: so many animation frames. */
const PAGE = 2;

export abstract class LeastCostController implements Controller {
  readonly #rungs: readonly number[];
  readonly #sizes: FrameSizes;
  readonly #server: ServerTimes;
  readonly #clock = new FrameClock();
  readonly #delay = new LinkDelay();
  #rung: number;
  #changedAt = Number.NEGATIVE_INFINITY;
  #upgradedAt = Number.NEGATIVE_INFINITY;
  #possibleSince: number | undefined;
  #hold = MIN_HOLD;

  constructor(ladder: readonly Rung[]) {
    this.#rungs = ladder.map((_, rung) => rung);
    this.#sizes = new FrameSizes(ladder);
    this.#server = new ServerTimes(ladder);
    this.#rung = ladder.length - 1;
  }

  /** Of a frame of that rung, which takes so long. */
  protected abstract cost(rung: number, times: FrameTimes): number;

  /** Another rung must cost less than this, where the present one costs so much. */
  protected abstract less(cost: number): number;

  decide(now: number): number {
    this.#clock.tick(now);
    return this.#rung;
  }

  observe(observation: Observation): void {
    const { profile, arrival, server, throughput, at } = observation;
    this.#sizes.observe(profile, arrival.bytes);
    this.#server.observe(profile, server, at);
    if (throughput === null) return;
    if (arrival.sentAt > this.#changedAt) {
      // What was asked for before the last change says nothing of what came of it.
      const network = responseTime(observation) - serverTime(observation);
      this.#delay.observe(Math.max(0, network - (arrival.bytes * 8000) / throughput), at);
    }
    const own = this.#sizes.expected(this.#rung);
    const seems = (own * 8000) / throughput;
    const jitter = Math.min(this.#delay.jitter, MOST_JITTER * seems);
    const link = (rung: number) => jitter + ((seems - jitter) * this.#sizes.expected(rung)) / own;
    this.#choose((rung) => this.cost(rung, this.#times(rung, link(rung))), at);
  }

  #times(rung: number, link: number): FrameTimes {
    const { total, stage } = this.#server.expected(rung);
    const { interval } = this.#clock;
    return {
      server: total,
      link,
      interval: Math.max(interval, link, stage),
      trip: this.#delay.average + PAGE * interval,
    };
  }

  #choose(cost: (rung: number) => number, now: number): void {
    const enough = this.less(cost(this.#rung));
    const lower = this.#rungs.slice(this.#rung + 1);
    const least = lower.reduce((best, rung) => (cost(rung) < cost(best) ? rung : best), this.#rung);
    const judged = this.#delay.frames >= JUDGED;
    const queued = judged && this.#delay.queue > QUEUE * this.#clock.interval;
    if (queued && lower.length === 0) {
      this.#delay.forget(); // no rung of ours makes it: the way has become longer
    } else if (queued || (judged && cost(least) < enough)) {
      this.#change(Math.max(least, queued ? this.#rung + 1 : 0), now);
      const failed = now - this.#upgradedAt < PROVEN;
      this.#hold = failed ? Math.min(MAX_HOLD, 2 * this.#hold) : Math.max(MIN_HOLD, this.#hold / 2);
    } else if (this.#rung === 0 || cost(this.#rung - 1) >= enough) {
      this.#possibleSince = undefined;
    } else {
      this.#possibleSince ??= now;
      if (now - this.#possibleSince < this.#hold) return;
      this.#change(this.#rung - 1, now);
      this.#upgradedAt = now;
    }
  }

  #change(rung: number, now: number): void {
    this.#rung = rung;
    this.#changedAt = now;
    this.#delay.restart();
    this.#possibleSince = undefined;
  }
}
