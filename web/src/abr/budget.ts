/**
 * Our own controller, *Budget*: what a frame may cost in time for each doubling of its bytes. It takes the rung with the least
 *
 *     cost(ℓ) = server(ℓ) + link(ℓ) + interval(ℓ) + price · log₂(E(0) / E(ℓ))
 *     link(ℓ) = j + (S(k) / r − j) · S(ℓ) / S(k)
 *     interval(ℓ) = max(f, link(ℓ), stage(ℓ))
 *
 * `E` is what the ladder expects of a rung's bytes, `S` what its frames take, `k` the rung in use, `r` the link's throughput, `stage`
 * what frames take in the server's slowest stage, `f` an animation frame. The interval counts because what is longer than an
 * animation frame makes the next ones wait. Jitter `j` makes a frame's packets come apart by as much whether they are two or twenty:
 * it must not be scaled with a frame's size. What is alike for all rungs, such as the round trip, decides nothing.
 *
 * It begins with a rung whose frames fit into QUIC's first window and, for BEGINNING, goes up with the first frame of each rung,
 * unless one has to be taken back. From then on it goes down at once and as far as needed, and up when that has been possible
 * for a while; an upgrade that had to be taken back soon makes the next one wait twice as long. Upwards, bytes grow by at most STEP
 * at a time: of much larger frames, what was seen says little. Where frames wait on the link although none should, it goes down, too.
 */
import type { Rung } from "../wire/render";
import {
  type Controller,
  type ControllerContext,
  type Observation,
  responseTime,
  serverTime,
  type Way,
} from "./controller";
import { FrameClock } from "./frame-clock";
import { LinkDelay } from "./link-delay";
import { ServerTimes } from "./server-times";
import { FrameSizes } from "./sizes";

/** Milliseconds that a picture of twice the bytes is worth: more where the page hides how late it is (docs/abr.md). */
const PRICE: Readonly<Record<Way, number>> = { stale: 10, rotation: 20, depth: 20, predicted: 40 };
/**
 * Where pictures are shown as they came and each takes the server longer than this, in milliseconds, even at the last rung, they are old
 * anyway: their error grows with the square root of their age (docs/reprojection.md), so that another millisecond matters less.
 */
const SLOW_SERVER = 12;
/** Another rung must cost so much less, as a share of the price. */
const BETTER = 0.3;
/** Frames that wait for more than so many animation frames have a queue before them. */
const QUEUE = 2;
/** Jitter makes up at most this much of what frames seem to take on the link. */
const MOST_JITTER = 0.75;
/** A rung is judged by its own frames: it is not left before so many have come, or have kept the link so many milliseconds, but upwards in the beginning. */
const JUDGED = 5;
const LONG = 500;
/** What QUIC sends before the first acknowledgement (RFC 9002, section 7.2), less a fifth for margins, depth and headers. In kB. */
const FIRST_WINDOW = 0.8 * 14.72;
/** An upgrade multiplies bytes by at most so much, unless it is to the neighbour. */
const STEP = 3;
/** It takes QUIC several round trips to find out what the link carries: so many milliseconds are the beginning at most. */
const BEGINNING = 2000;
/** An upgrade waits until it has been possible for so long, in milliseconds; at most MAX_HOLD after failures. */
const MIN_HOLD = 500;
const MAX_HOLD = 8000;
/** An upgrade that is taken back within this many milliseconds has failed. */
const PROVEN = 1000;

/** What a frame of a rung costs, in milliseconds. */
type Cost = (rung: number) => number;

export class BudgetController implements Controller {
  /** How often the best rung's bytes are halved to be a rung's. */
  readonly #halvings: readonly number[];
  readonly #rungs: readonly number[];
  readonly #sizes: FrameSizes;
  readonly #server: ServerTimes;
  readonly #clock = new FrameClock();
  readonly #delay = new LinkDelay();
  #rung: number;
  #beginning = true;
  #begunAt: number | undefined;
  #changedAt = Number.NEGATIVE_INFINITY;
  #upgradedAt = Number.NEGATIVE_INFINITY;
  #possibleSince: number | undefined;
  #hold = MIN_HOLD;

  constructor({ ladder }: Pick<ControllerContext, "ladder">) {
    const best = ladder[0]?.expected_kb ?? 1;
    this.#halvings = ladder.map(({ expected_kb }) => Math.log2(best / expected_kb));
    this.#rungs = ladder.map((_, rung) => rung);
    this.#sizes = new FrameSizes(ladder);
    this.#server = new ServerTimes(ladder);
    this.#rung = firstRung(ladder);
  }

  decide(now: number): number {
    this.#clock.tick(now);
    return this.#rung;
  }

  observe(observation: Observation): void {
    const { profile, arrival, server, throughput, way, at } = observation;
    this.#sizes.observe(profile, arrival.bytes);
    this.#server.observe(profile, server, at);
    if (throughput === null) return;
    this.#begunAt ??= at;
    if (at - this.#begunAt > BEGINNING) this.#beginning = false;
    if (arrival.sentAt > this.#changedAt) {
      // What was asked for before the last change says nothing of what came of it.
      const network = responseTime(observation) - serverTime(observation);
      this.#delay.observe(Math.max(0, network - (arrival.bytes * 8000) / throughput), at);
    }
    const price = this.#price(way);
    const long = (arrival.bytes * 8000 * this.#delay.frames) / throughput > LONG;
    this.#choose(this.#costs(throughput, price), BETTER * price, long, at);
  }

  /** Milliseconds that a picture of twice the bytes is worth. */
  #price(way: Way): number {
    const { stage } = this.#server.expected(this.#rungs.length - 1);
    return PRICE[way] * (way === "stale" ? Math.sqrt(Math.max(1, stage / SLOW_SERVER)) : 1);
  }

  #costs(throughput: number, price: number): Cost {
    const { interval } = this.#clock;
    const own = this.#sizes.expected(this.#rung);
    const seems = (own * 8000) / throughput;
    const jitter = Math.min(this.#delay.jitter, MOST_JITTER * seems);
    return (rung) => {
      const { total, stage } = this.#server.expected(rung);
      const link = jitter + ((seems - jitter) * this.#sizes.expected(rung)) / own;
      return total + link + Math.max(interval, link, stage) + price * (this.#halvings[rung] ?? 0);
    };
  }

  #choose(cost: Cost, margin: number, long: boolean, now: number): void {
    const reachable = this.#rungs.slice(this.#reach());
    const best = reachable.reduce((least, rung) => (cost(rung) < cost(least) ? rung : least), this.#rung);
    const better = cost(best) < cost(this.#rung) - margin;
    const { frames, queue } = this.#delay;
    const judged = frames >= JUDGED || long;
    const queued = judged && queue > QUEUE * this.#clock.interval;
    if (queued && this.#rung === this.#rungs.length - 1) {
      this.#delay.forget(); // no rung of ours makes it: the way has become longer
    } else if (queued || (judged && better && best > this.#rung)) {
      this.#change(Math.max(best, queued ? this.#rung + 1 : 0), now);
      const failed = now - this.#upgradedAt < PROVEN;
      if (failed) this.#beginning = false;
      this.#hold = failed ? Math.min(MAX_HOLD, 2 * this.#hold) : Math.max(MIN_HOLD, this.#hold / 2);
    } else if (!better || best > this.#rung) {
      this.#possibleSince = undefined;
    } else {
      this.#possibleSince ??= now;
      if (this.#beginning ? frames === 0 : now - this.#possibleSince < this.#hold) return;
      this.#change(best, now);
      this.#upgradedAt = now;
    }
  }

  /** The best rung that it may go up to now. */
  #reach(): number {
    const most = STEP * this.#sizes.expected(this.#rung);
    const far = this.#rungs.findIndex((rung) => this.#sizes.expected(rung) <= most);
    return Math.max(0, Math.min(far, this.#rung - 1));
  }

  #change(rung: number, now: number): void {
    this.#rung = rung;
    this.#changedAt = now;
    this.#delay.restart();
    this.#possibleSince = undefined;
  }
}

/** The best one whose frames come in a single round trip, whatever the link carries. */
function firstRung(ladder: readonly Rung[]): number {
  const first = ladder.findIndex(({ expected_kb }) => expected_kb <= FIRST_WINDOW);
  return first < 0 ? ladder.length - 1 : first;
}
