/**
 * Our own controller, *Budget*: it prices a doubling of a frame's bytes in milliseconds and takes the rung with the
 * least
 *
 *     cost(ℓ) = server(ℓ) + link(ℓ) + interval(ℓ) + price · log₂(E(0) / E(ℓ))
 *     link(ℓ) = j + (S(k) / r − j) · S(ℓ) / S(k)
 *     interval(ℓ) = max(f, link(ℓ), stage(ℓ))
 *
 * `E` is the size of a rung's frames expected by the ladder, `S` their estimated size, `k` the rung in use, `r` the
 * throughput of the link, `stage` the time in the server's slowest stage and `f` an animation frame. The interval
 * counts because a frame that takes longer than an animation frame delays the next ones. Jitter `j` spreads the packets
 * of a frame equally whether there are two or twenty, so it is not scaled with the frame's size. Terms equal for all
 * rungs, such as the round trip, are left out.
 *
 * It starts with a rung whose frames fit into QUIC's first window. During BEGINNING it goes up with the first frame of
 * each rung, unless an upgrade has to be reverted. After that it goes down at once and as far as needed, and up once
 * that has been possible for a while; reverting an upgrade early doubles the wait before the next one. An upgrade
 * multiplies bytes by at most STEP, because past frames predict little about much larger ones. It also goes down when
 * frames queue on the link, unless its frames are too small to be the cause.
 */
import {
  type Controller,
  type ControllerContext,
  type Observation,
  responseTime,
  serverTime,
  type Way,
} from "./controller";
import { FrameClock } from "./frame-clock";
import { firstRung } from "./ladder";
import { LinkDelay } from "./link-delay";
import { ServerTimes } from "./server-times";
import { FrameSizes } from "./sizes";

/** Milliseconds that a picture of twice the bytes is worth: more where the page hides how late it is (docs/adaptation.md). */
const PRICE: Readonly<Record<Way, number>> = { stale: 10, rotation: 20, depth: 20, predicted: 40 };
/**
 * No rung avoids the server time of the last rung; the longer that is, the less a few milliseconds matter. Beyond this
 * many milliseconds, the price moves from the usual one towards MOST_PRICE.
 */
const SLOW_SERVER = 12;
const MOST_PRICE = 45;
/** Minimum saving of another rung, as a share of the price. */
const BETTER = 0.3;
/** Frames that wait for more animation frames than this are queued. */
const QUEUE = 2;
/** Frames that take the link less than this share of an animation frame are no queue there, even if it is ten times as slow as it seems. */
const LIGHT = 0.1;
/** Largest share of a frame's link time that is attributed to jitter. */
const MOST_JITTER = 0.75;
/**
 * Each rung is judged by its own frames: it is left only after this many frames or milliseconds on the link, except
 * upwards in the beginning.
 */
const JUDGED = 5;
const LONG = 500;
/** Largest factor by which an upgrade multiplies bytes, unless it is to the neighbour. */
const STEP = 3;
/** Longest duration of the beginning, in milliseconds: QUIC needs several round trips to find the link's capacity. */
const BEGINNING = 2000;
/** An upgrade must have been possible for this long, in milliseconds; MAX_HOLD is the limit after failures. */
const MIN_HOLD = 500;
const MAX_HOLD = 8000;
/** An upgrade that is taken back within this many milliseconds has failed. */
const PROVEN = 1000;

/** Cost of a frame of a rung, in milliseconds. */
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
    const transmission = (arrival.bytes * 8000) / throughput;
    if (arrival.sentAt > this.#changedAt) {
      // Frames requested before the last change say nothing about its effect.
      const network = responseTime(observation) - serverTime(observation);
      this.#delay.observe(Math.max(0, network - transmission), at);
    }
    const price = this.#price(way);
    this.#choose(this.#costs(throughput, price), BETTER * price, transmission, at);
  }

  /** Milliseconds that a picture of twice the bytes is worth. */
  #price(way: Way): number {
    const { stage } = this.#server.expected(this.#rungs.length - 1);
    const share = Math.min(1, SLOW_SERVER / stage);
    return share * PRICE[way] + (1 - share) * MOST_PRICE;
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

  #choose(cost: Cost, margin: number, transmission: number, now: number): void {
    const reachable = this.#rungs.slice(this.#reach());
    const best = reachable.reduce((least, rung) => (cost(rung) < cost(least) ? rung : least), this.#rung);
    const better = cost(best) < cost(this.#rung) - margin;
    const { frames, queue } = this.#delay;
    const judged = frames >= JUDGED || transmission * frames > LONG;
    const waiting = judged && queue > QUEUE * this.#clock.interval;
    const ours = this.#rung < this.#rungs.length - 1 && transmission > LIGHT * this.#clock.interval;
    if (waiting && !ours) {
      this.#delay.forget(); // no rung makes it shorter: the way has become longer, or the page is busy
    } else if (waiting || (judged && better && best > this.#rung)) {
      this.#change(Math.max(best, waiting ? this.#rung + 1 : 0), now);
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
