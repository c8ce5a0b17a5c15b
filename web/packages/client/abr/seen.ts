/**
 * The default controller, *Seen*: it takes the rung with the best picture expected on the screen, which is both as sharp
 * as the rung and as old as its frames. With `PSNR` and `SSIM` of a rung's picture after the camera has turned
 * (seen-error.ts), and the distribution of recent turning speeds v,
 *
 *     utility(ℓ) = E_v[PSNR(ℓ, v · age(ℓ)) + WEIGHT · SSIM(ℓ, v · age(ℓ))]
 *     age(ℓ) = delay + queue · S(ℓ) / S(k) + server(ℓ) + link(ℓ) + interval(ℓ) / 2 + PAGE
 *     link(ℓ) = j + (S(k) / r − j) · S(ℓ) / S(k)
 *     interval(ℓ) = max(f, link(ℓ), stage(ℓ))
 *
 * `S` is the estimated size of a rung's frames, `k` the rung in use, `r` the rate at which frames get through
 * (link-rate.ts), `delay` and `queue` the time that frames spend outside the server without their own transmission,
 * `stage` the time in the server's slowest stage, `f` an animation frame and `j` the link's jitter, which spreads the
 * packets of a frame equally whether there are two or twenty. Without reprojection the user feels the age of frames as
 * latency, so it also costs LATENCY · age(ℓ).
 *
 * Rungs with intervals longer than LONGEST are worse than all others. It goes down as far as needed, at once if that is
 * better by URGENT, or else once it has been better by MARGIN for LASTING. It goes up once that has been better by
 * MARGIN for a while even on a link with CAUTION times the rate: by one rung, or back to one that it had to leave;
 * reverting an upgrade early doubles the wait before the next one. It starts with a rung whose frames fit into QUIC's
 * first window, and goes up by as many as FIRST_STEP rungs after as many frames during BEGINNING.
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
import { LinkRate } from "./link-rate";
import { decibels, type Seen, seenLate, seenOfRung, together } from "./seen-error";
import { ServerTimes } from "./server-times";
import { FrameSizes } from "./sizes";

/** Upper bounds of the classes, and the speeds that represent them, in degrees per second. */
const ENDS = [2, 7, 15, 27, 47, 80, 140, Number.POSITIVE_INFINITY];
const SPEEDS = [1, 4, 10, 20, 35, 60, 100, 180];
/** Time constant of the average, in milliseconds. */
const MEMORY = 2000;

export class TurningSpeeds {
  #shares: readonly number[] = SPEEDS.map(() => 1 / SPEEDS.length);
  #at = Number.NEGATIVE_INFINITY;

  /** Records a speed in degrees per second, at a time in milliseconds. */
  observe(speed: number, at: number): void {
    const kept = Math.exp((this.#at - at) / MEMORY);
    this.#at = at;
    const own = ENDS.findIndex((end) => speed < end);
    this.#shares = this.#shares.map((share, i) => kept * share + (i === own ? 1 - kept : 0));
  }

  /** Expected value of a function of the speed. */
  expect(value: (speed: number) => number): number {
    return this.#shares.reduce((sum, share, i) => (share > 0 ? sum + share * value(SPEEDS[i] ?? 0) : sum), 0);
  }
}

/** Value of an SSIM of 1, in decibels. */
const WEIGHT = 150;
/** Minimum gain of another rung, in decibels. */
const MARGIN = 0.8;
/** Gain at which a downgrade happens at once, in decibels. */
const URGENT = 4;
/** Smaller gains of a downgrade must last for this many milliseconds. */
const LASTING = 2000;
/** Cost of a millisecond without reprojection, in decibels. */
const LATENCY = 0.02;
/** Share of the rate that an upgrade may count on. */
const CAUTION = 0.75;
/** Decoding and display, in milliseconds. */
const PAGE = 25;
/** Rungs with a longer interval between frames are avoided, in milliseconds: pictures would stutter. */
const LONGEST = 250;
/** Largest share of a frame's link time that is attributed to jitter. */
const MOST_JITTER = 0.75;
/** A rung is left only after this many of its frames, or milliseconds of them on the link, except in the beginning. */
const JUDGED = 5;
const LONG = 500;
/** Longest duration of the beginning, in milliseconds: QUIC needs several round trips to find the link's capacity. */
const BEGINNING = 2000;
/** Largest upgrade in the beginning, in rungs; as many frames precede each. */
const FIRST_STEP = 2;
/** An upgrade must have been better for this long, in milliseconds; MAX_HOLD is the limit after failures. */
const MIN_HOLD = 500;
const MAX_HOLD = 8000;
/** An upgrade that is reverted within this many milliseconds has failed. */
const PROVEN = 2000;

/** Expected quality of a rung on the screen, in decibels. */
type Utility = (rung: number) => number;

export class SeenController implements Controller {
  readonly #pictures: readonly Seen[];
  readonly #sizes: FrameSizes;
  readonly #server: ServerTimes;
  readonly #clock = new FrameClock();
  readonly #delay = new LinkDelay();
  readonly #rate = new LinkRate();
  readonly #speeds = new TurningSpeeds();
  #rung: number;
  #beginning = true;
  #begunAt: number | undefined;
  #changedAt = Number.NEGATIVE_INFINITY;
  #upgradedAt = Number.NEGATIVE_INFINITY;
  /** The best rung that it had to leave and has not returned to. */
  #left = Number.POSITIVE_INFINITY;
  #worseSince: number | undefined;
  #possibleSince: number | undefined;
  #hold = MIN_HOLD;

  constructor({ ladder }: Pick<ControllerContext, "ladder">) {
    this.#pictures = ladder.map(seenOfRung);
    this.#sizes = new FrameSizes(ladder);
    this.#server = new ServerTimes(ladder);
    this.#rung = firstRung(ladder);
  }

  decide(now: number): number {
    this.#clock.tick(now);
    return this.#rung;
  }

  observe(observation: Observation): void {
    const { profile, arrival, server, throughput, turning, way, at } = observation;
    this.#sizes.observe(profile, arrival.bytes);
    this.#server.observe(profile, server, at);
    this.#speeds.observe(turning, at);
    if (throughput === null) return;
    this.#begunAt ??= at;
    if (at - this.#begunAt > BEGINNING) this.#beginning = false;
    const transmission = (arrival.bytes * 8000) / throughput;
    const network = responseTime(observation) - serverTime(observation);
    const pace = Math.max(this.#clock.interval, this.#server.expected(this.#rung).stage);
    this.#rate.observe({ bytes: arrival.bytes, network, transmission, pace, at });
    // Frames requested before the last change say nothing about its effect.
    const rate = this.#rate.bitsPerSecond;
    if (arrival.sentAt > this.#changedAt) this.#delay.observe(Math.max(0, network - (arrival.bytes * 8000) / rate), at);
    const { frames } = this.#delay;
    const judged = frames >= JUDGED || transmission * frames > LONG;
    if (judged && this.#lower(this.#utility(Math.min(rate, throughput), way), at)) return;
    this.#raise(this.#utility(CAUTION * rate, way), at);
  }

  #utility(rate: number, way: Way): Utility {
    const { interval } = this.#clock;
    const { average, queue, jitter } = this.#delay;
    const own = this.#sizes.expected(this.#rung);
    const seems = (own * 8000) / rate;
    const jittered = Math.min(jitter, MOST_JITTER * seems);
    return (rung) => {
      const times = this.#sizes.expected(rung) / own;
      const { total, stage } = this.#server.expected(rung);
      const link = jittered + (seems - jittered) * times;
      if (Math.max(link, stage) > LONGEST && rung < this.#pictures.length - 1) return -Math.max(link, stage);
      const delay = Math.max(0, average - queue) + queue * times;
      const age = delay + total + link + Math.max(interval, link, stage) / 2 + PAGE;
      return this.#quality(rung, age, way) - (way === "stale" ? LATENCY * age : 0);
    };
  }

  #quality(rung: number, age: number, way: Way): number {
    const picture = this.#pictures[rung] ?? { mse: 0, ssim: 1 };
    return this.#speeds.expect((speed) => {
      const { mse, ssim } = together(picture, seenLate(way, (speed * age) / 1000));
      return decibels(mse) + WEIGHT * ssim;
    });
  }

  /** The best rung from `first` to `last` if it is better than the one in use by MARGIN, or else the one in use. */
  #best(utility: Utility, first: number, last: number): number {
    let best = { rung: this.#rung, value: utility(this.#rung) + MARGIN };
    for (let rung = first; rung <= last; rung++) {
      const value = utility(rung);
      if (value > best.value) best = { rung, value };
    }
    return best.rung;
  }

  /** Goes to the best of the lower rungs if that is much better, or has been better for long enough; returns whether it did. */
  #lower(utility: Utility, now: number): boolean {
    const best = this.#best(utility, this.#rung + 1, this.#pictures.length - 1);
    if (best === this.#rung) {
      this.#worseSince = undefined;
      return false;
    }
    this.#worseSince ??= now;
    if (now - this.#worseSince < LASTING && utility(best) - utility(this.#rung) < URGENT) return false;
    this.#left = Math.min(this.#left, this.#rung);
    this.#change(best, now);
    const failed = now - this.#upgradedAt < PROVEN;
    if (failed) this.#beginning = false;
    this.#hold = failed ? Math.min(MAX_HOLD, 2 * this.#hold) : Math.max(MIN_HOLD, this.#hold / 2);
    return true;
  }

  /** Goes up if that has been better for long enough. */
  #raise(utility: Utility, now: number): void {
    const next = this.#rung - 1;
    const first = this.#beginning ? this.#rung - FIRST_STEP : Math.min(this.#left, next);
    const best = this.#best(utility, Math.max(0, first), next);
    if (best === this.#rung) {
      this.#possibleSince = undefined;
      return;
    }
    this.#possibleSince ??= now;
    if (this.#beginning ? this.#delay.frames < FIRST_STEP : now - this.#possibleSince < this.#hold) return;
    this.#change(best, now);
    this.#upgradedAt = now;
    if (best <= this.#left) this.#left = Number.POSITIVE_INFINITY;
  }

  #change(rung: number, now: number): void {
    this.#rung = rung;
    this.#changedAt = now;
    this.#delay.restart();
    this.#worseSince = undefined;
    this.#possibleSince = undefined;
  }
}
