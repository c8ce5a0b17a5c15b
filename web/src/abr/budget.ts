/**
 * Our own controller, *Budget*: a frame may take WORTH longer for each doubling of its bytes. It takes the rung that costs least:
 *
 *     cost(ℓ) = server(ℓ) + link(ℓ) + max(f, link(ℓ), stage(ℓ)) + WORTH · log₂(E(0) / E(ℓ))
 *     link(ℓ) = j + (S(k) / r − j) · S(ℓ) / S(k)
 *
 * `S` is what frames of a rung take and `E` what the ladder expects of them, `k` the rung in use, `r` the link's throughput,
 * `server` and `stage` what they take in the server and in its slowest stage, `f` an animation frame. The maximum is the time
 * between frames: what is longer than an animation frame makes the next ones wait, and so counts twice. Jitter `j` makes a
 * frame's packets come apart by as much whether they are two or twenty: it must not be scaled with a frame's size. What is alike
 * for all rungs, such as the round trip, decides nothing: a better picture costs as much near the server as far from it.
 *
 * Down at once and as far as needed; up one rung, when it has been possible for a while. An upgrade that had to be taken back
 * soon makes the next one wait twice as long. Where frames wait on the link although none should, it goes down, too.
 */
import { type Controller, type ControllerContext, type Observation, responseTime, serverTime } from "./controller";
import { FrameClock } from "./frame-clock";
import { LinkDelay } from "./link-delay";
import { ServerTimes } from "./server-times";
import { FrameSizes } from "./sizes";

/** Milliseconds that a picture of twice the bytes is worth. */
const WORTH = 10;
/** Another rung must cost so much less, in milliseconds. */
const BETTER = 3;
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

export class BudgetController implements Controller {
  /** What the rungs' pictures cost, in milliseconds. */
  readonly #pictures: readonly number[];
  readonly #sizes: FrameSizes;
  readonly #server: ServerTimes;
  readonly #clock = new FrameClock();
  readonly #delay = new LinkDelay();
  #rung: number;
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
    this.#choose((rung) => this.#cost(rung, jitter + ((seems - jitter) * this.#sizes.expected(rung)) / own), at);
  }

  /** `link`: the milliseconds that a frame of the rung takes there. */
  #cost(rung: number, link: number): number {
    const { total, stage } = this.#server.expected(rung);
    return total + link + Math.max(this.#clock.interval, link, stage) + (this.#pictures[rung] ?? 0);
  }

  #choose(cost: (rung: number) => number, now: number): void {
    const enough = cost(this.#rung) - BETTER;
    const lower = this.#pictures.map((_, rung) => rung).slice(this.#rung + 1);
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
