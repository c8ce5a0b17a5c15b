/**
 * The first version of *Budget*, kept as the baseline of `abr-bench`.
 *
 * The time for transmission is 100 ms less the round trip, the server and the page.
 *
 *     motion-to-photon(ℓ) = trip + server + page + transmission(ℓ)
 *     transmission(ℓ) = S(ℓ) / throughput,  at most one animation frame
 *
 * `trip` is the minimum time of recent frames outside the server beyond their own transmission: propagation without any
 * queue. `page` is a pose's wait for its request, decoding and display. A frame that takes longer on the link than an
 * animation frame delays the next ones, each by a whole transmission, so that is never worth it while a lower rung is
 * left.
 *
 * If the delay beyond trip and server grows from frame to frame (the delay gradient), the queue is filling whatever the
 * estimated throughput; the extrapolated delay one response later counts. Down at once and as far as needed; up one
 * rung, once that has been possible for a while. Reverting an upgrade early doubles the wait before the next one.
 */
import {
  type Controller,
  type ControllerContext,
  type Observation,
  responseTime,
  serverTime,
} from "#client/abr/controller";
import { FrameSizes } from "#client/abr/sizes";

/** Latency still perceived as immediate, in milliseconds. */
const BUDGET = 100;
const ANIMATION_FRAME = 1000 / 60;
/** A pose waits for its request for up to an animation frame and for the screen for another; decoding is between (ms). */
const PAGE = 2 * ANIMATION_FRAME + 4;
/** A pose that just made it waits for decoding and one animation frame at least (ms). */
const LEAST_PAGE = ANIMATION_FRAME + 4;
/** The least that bytes get while the budget can be kept at all, in milliseconds. */
const LEAST = 6;
/** A rung is left when it takes this much more than allowed, and taken when it takes this much less. */
const LEAVE = 1.1;
const TAKE = 0.9;
/** Milliseconds that the delay grows in a millisecond while a queue fills: not the time to go up. */
const FILLING = 0.2;
/** A trip is the least of this many milliseconds. */
const TRIP_SPAN = 10_000;
/** Weight of the newest frame in averages. */
const ALPHA = 0.3;
/** An upgrade must have been possible for this long, in milliseconds; MAX_HOLD is the limit after failures. */
const MIN_HOLD = 150;
const MAX_HOLD = 2400;
/** An upgrade that is taken back within this many milliseconds has failed. */
const PROVEN = 1000;

export class FirstBudgetController implements Controller {
  readonly #sizes: FrameSizes;
  readonly #lowest: number;
  #rung: number;
  /** Possible minima of the trip: ascending in time and value. */
  #trips: { readonly at: number; readonly value: number }[] = [];
  #server: number | undefined;
  /** Delay beyond trip and server, in milliseconds, and its change a millisecond. */
  #delay = 0;
  #gradient = 0;
  #heardAt = 0;
  #possibleSince: number | undefined;
  #upgradedAt = Number.NEGATIVE_INFINITY;
  #hold = MIN_HOLD;

  constructor({ ladder }: Pick<ControllerContext, "ladder">) {
    this.#sizes = new FrameSizes(ladder);
    this.#lowest = ladder.length - 1;
    this.#rung = this.#lowest;
  }

  decide(): number {
    return this.#rung;
  }

  observe(observation: Observation): void {
    const { profile, arrival, throughput, at } = observation;
    this.#sizes.observe(profile, arrival.bytes);
    if (throughput === null) return;
    const spent = serverTime(observation);
    const network = responseTime(observation) - spent;
    const trip = this.#learnTrip(Math.max(0, network - (arrival.bytes * 8000) / throughput), at);
    this.#server = mix(this.#server ?? spent, spent, ALPHA);
    this.#learnDelay(network - trip, at);
    const allowed = allowedTransmission(trip + this.#server);
    this.#choose((rung) => (this.#sizes.expected(rung) * 8000) / throughput, allowed, trip, at);
  }

  #choose(transmission: (rung: number) => number, allowed: number, trip: number, now: number): void {
    const growing = this.#growing(trip, allowed);
    const tooMuch = (rung: number) => rung < this.#lowest && transmission(rung) > allowed * LEAVE;
    if (tooMuch(this.#rung) || (growing && this.#rung < this.#lowest)) {
      do this.#rung++;
      while (tooMuch(this.#rung));
      this.#hold =
        now - this.#upgradedAt < PROVEN ? Math.min(MAX_HOLD, 2 * this.#hold) : Math.max(MIN_HOLD, this.#hold / 2);
      this.#gradient = 0;
      this.#possibleSince = undefined;
    } else if (this.#rung === 0 || this.#gradient > FILLING || transmission(this.#rung - 1) > allowed * TAKE) {
      this.#possibleSince = undefined;
    } else {
      this.#possibleSince ??= now;
      if (now - this.#possibleSince < this.#hold) return;
      this.#rung--;
      this.#upgradedAt = now;
      this.#possibleSince = undefined;
    }
  }

  /** The queue is filling, and its extrapolation one response later is too late. */
  #growing(trip: number, allowed: number): boolean {
    if (this.#gradient <= 0 || this.#server === undefined) return false;
    const fixed = trip + this.#server;
    const then = this.#delay + this.#gradient * (fixed + this.#delay);
    return then > Math.max(BUDGET - PAGE - fixed, 3 * allowed);
  }

  #learnTrip(value: number, at: number): number {
    this.#trips = this.#trips.filter((trip) => trip.at > at - TRIP_SPAN && trip.value < value);
    this.#trips.push({ at, value });
    return this.#trips[0]?.value ?? value;
  }

  #learnDelay(delay: number, at: number): void {
    const before = this.#delay;
    this.#delay = mix(before, delay, ALPHA);
    this.#gradient = mix(this.#gradient, (this.#delay - before) / Math.max(1, at - this.#heardAt), ALPHA);
    this.#heardAt = at;
  }
}

/**
 * Milliseconds available to a frame on the link, less those spent on any frame. If even an empty frame would be late,
 * small frames gain nothing, and only the next frames must not wait.
 */
function allowedTransmission(fixed: number): number {
  if (fixed > BUDGET - LEAST_PAGE) return ANIMATION_FRAME;
  return Math.min(ANIMATION_FRAME, Math.max(LEAST, BUDGET - PAGE - fixed));
}

function mix(average: number, value: number, weight: number): number {
  return average + weight * (value - average);
}
