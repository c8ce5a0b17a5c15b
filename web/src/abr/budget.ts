/**
 * Our own controller, *Budget*: a frame may take WORTH longer for each doubling of its bytes. It takes the rung that costs least:
 *
 *     cost(ℓ) = server(ℓ) + S(ℓ) / r + max(f, S(ℓ) / r, stage(ℓ)) + WORTH · log₂(E(0) / E(ℓ))
 *
 * `S` is what frames of a rung take and `E` what the ladder expects of them, `r` the link's throughput, `server` and `stage` what
 * they take in the server and in its slowest stage, `f` an animation frame. The maximum is the time between frames: what is
 * longer than an animation frame makes the next ones wait, and so counts twice. What is alike for all rungs, such as the round
 * trip, decides nothing: a better picture costs as much near the server as far from it.
 *
 * Down at once and as far as needed; up one rung, when it has been possible for a while. An upgrade that had to be taken back
 * soon makes the next one wait twice as long. Where frames wait on the link although none should, it goes down, too.
 */
import { type Controller, type ControllerContext, type Observation, responseTime, serverTime } from "./controller";
import { FrameClock } from "./frame-clock";
import { RecentMinimum } from "./recent-minimum";
import { ServerTimes } from "./server-times";
import { FrameSizes } from "./sizes";

/** Milliseconds that a picture of twice the bytes is worth. */
const WORTH = 10;
/** Another rung must cost so much less, in milliseconds. */
const BETTER = 3;
/** A frame that waits for longer than so many animation frames beyond its own transmission has a queue before it. */
const QUEUE = 2;
/** The trip is the least of this many milliseconds. */
const TRIP_SPAN = 10_000;
/** Weight of the newest frame in the queue's average. */
const ALPHA = 0.3;
/** An upgrade waits until it has been possible for so long, in milliseconds; at most MAX_HOLD after failures. */
const MIN_HOLD = 500;
const MAX_HOLD = 4000;
/** An upgrade that is taken back within this many milliseconds has failed. */
const PROVEN = 1000;

export class BudgetController implements Controller {
  /** What the rungs' pictures cost, in milliseconds. */
  readonly #pictures: readonly number[];
  readonly #sizes: FrameSizes;
  readonly #server: ServerTimes;
  readonly #clock = new FrameClock();
  readonly #trips = new RecentMinimum(TRIP_SPAN);
  #rung: number;
  /** Milliseconds that frames wait on the link for those before them. */
  #queue = 0;
  #changedAt = Number.NEGATIVE_INFINITY;
  #upgradedAt = Number.NEGATIVE_INFINITY;
  #possibleSince: number | undefined;
  #hold = MIN_HOLD;

  constructor({ ladder }: Pick<ControllerContext, "ladder">) {
    const best = ladder[0]?.expected_kb ?? 1;
    this.#pictures = ladder.map(({ expected_kb }) => WORTH * Math.log2(best / expected_kb));
    this.#sizes = new FrameSizes(ladder);
    this.#server = new ServerTimes(ladder);
    this.#rung = ladder.length - 1;
  }

  decide(now: number): number {
    this.#clock.tick(now);
    return this.#rung;
  }

  observe(observation: Observation): void {
    const { profile, server, throughput, at } = observation;
    this.#sizes.observe(profile, observation.arrival.bytes);
    this.#server.observe(profile, server, at);
    if (throughput === null) return;
    this.#learnQueue(observation, throughput);
    this.#choose((rung) => this.#cost(rung, throughput), at);
  }

  #cost(rung: number, throughput: number): number {
    const { total, stage } = this.#server.expected(rung);
    const transmission = (this.#sizes.expected(rung) * 8000) / throughput;
    const interval = Math.max(this.#clock.interval, transmission, stage);
    return total + transmission + interval + (this.#pictures[rung] ?? 0);
  }

  #choose(cost: (rung: number) => number, now: number): void {
    const enough = cost(this.#rung) - BETTER;
    const lower = this.#pictures.map((_, rung) => rung).slice(this.#rung + 1);
    const least = lower.reduce((best, rung) => (cost(rung) < cost(best) ? rung : best), this.#rung);
    const queued = this.#queue > QUEUE * this.#clock.interval && lower.length > 0;
    if (queued || cost(least) < enough) {
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
    this.#queue = 0;
    this.#possibleSince = undefined;
  }

  /** Frames that were asked for before the last change say nothing of the queue since. */
  #learnQueue(observation: Observation, throughput: number): void {
    const { arrival, at } = observation;
    const network = responseTime(observation) - serverTime(observation);
    const beyond = Math.max(0, network - (arrival.bytes * 8000) / throughput);
    const trip = this.#trips.add(beyond, at);
    if (arrival.sentAt > this.#changedAt) this.#queue += ALPHA * (beyond - trip - this.#queue);
  }
}
