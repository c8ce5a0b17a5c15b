/**
 * Our own controller, *Budget*: what the round trip and the server leave of 100 ms is what bytes may take.
 *
 *     response(ℓ) = trip + server + cost(ℓ)
 *
 * `trip` is the least time that frames of the last seconds spent outside the server beyond their own transmission: the way
 * there and back, without any queue. What a frame took beyond trip and server is what its bytes cost, waiting in our own
 * queue included, and that grows with the bytes: cost(ℓ) = observed cost × S(ℓ) / bytes observed. Whether it is still growing
 * (the delay gradient) is added for the time until a decision has its effect, one response.
 *
 * Up one rung only if its frames also fit in a cautious throughput (the average less its mean deviation) one after another at
 * MIN_RATE, with a second one waiting, as the pipeline keeps one more than the link can carry at a time. Down at once, as far
 * as needed. An upgrade that had to be taken back soon makes the next one wait twice as long.
 */
import { type Controller, type ControllerContext, type Observation, responseTime, serverTime } from "./controller";
import { FrameSizes } from "./sizes";

/** What a person still takes for at once, in milliseconds. */
const BUDGET = 100;
/** Where trip and server leave less than this, adapting cannot keep the budget: then the bytes get this much (ms). */
const LEAST_COST = 40;
/** Frames a second that a rung must leave room for. */
const MIN_RATE = 25;
/** A trip is the least of this many milliseconds. */
const TRIP_SPAN = 10_000;
/** Weight of the newest frame in averages. */
const ALPHA = 0.3;
/** Weight of the newest frame in the mean deviation of the throughput, as TCP takes it for its round trip (RFC 6298). */
const BETA = 0.25;
/** An upgrade waits until it has been possible for so long, in milliseconds; at most MAX_HOLD after failures. */
const MIN_HOLD = 500;
const MAX_HOLD = 8000;
/** An upgrade that lasts this much longer than its hold did not fail. */
const PROVEN = 4;

export class BudgetController implements Controller {
  readonly #sizes: FrameSizes;
  readonly #lowest: number;
  #rung: number;
  #trips: { readonly at: number; readonly value: number }[] = [];
  #server = 0;
  /** Milliseconds that a byte costs, and how that changes per millisecond. */
  #costPerByte: number | undefined;
  #gradient = 0;
  #heardAt = 0;
  #deviation = 0;
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
    if (throughput === null || arrival.bytes === 0) return;
    const transmission = (arrival.bytes * 8000) / throughput;
    const network = responseTime(observation) - serverTime(observation);
    const trip = this.#learnTrip(Math.max(0, network - transmission), at);
    const first = this.#costPerByte === undefined;
    this.#server = first ? serverTime(observation) : mix(this.#server, serverTime(observation), ALPHA);
    this.#learnCost(Math.max(0, network - trip) / arrival.bytes, at);
    this.#deviation = mix(this.#deviation, Math.abs(this.#lastThroughput(observation) - throughput), BETA);
    this.#choose(trip, throughput, at);
  }

  #choose(trip: number, throughput: number, now: number): void {
    const allowed = Math.max(LEAST_COST, BUDGET - trip - this.#server);
    if (this.#rung < this.#lowest && this.#costOf(this.#rung, trip) > allowed) {
      while (this.#rung < this.#lowest && this.#costOf(this.#rung, trip) > allowed) this.#rung++;
      if (now - this.#upgradedAt < PROVEN * this.#hold) this.#hold = Math.min(MAX_HOLD, 2 * this.#hold);
      this.#possibleSince = undefined;
      return;
    }
    if (now - this.#upgradedAt > 2 * PROVEN * this.#hold) this.#hold = Math.max(MIN_HOLD, this.#hold / 2);
    if (this.#rung === 0 || !this.#fits(this.#rung - 1, allowed, trip, throughput)) {
      this.#possibleSince = undefined;
      return;
    }
    this.#possibleSince ??= now;
    if (now - this.#possibleSince < this.#hold) return;
    this.#rung--;
    this.#upgradedAt = now;
    this.#possibleSince = undefined;
  }

  /** What a frame of a rung costs by what the last frames cost, a response from now. */
  #costOf(rung: number, trip: number): number {
    const bytes = this.#sizes.expected(rung);
    const now = (this.#costPerByte ?? 0) * bytes;
    return now + Math.max(0, this.#gradient * bytes) * (trip + this.#server + now);
  }

  #fits(rung: number, allowed: number, trip: number, throughput: number): boolean {
    const cautious = throughput - this.#deviation;
    if (cautious <= 0 || this.#costOf(rung, trip) > allowed) return false;
    const transmission = (this.#sizes.expected(rung) * 8000) / cautious;
    return transmission <= 1000 / MIN_RATE && 2 * transmission <= allowed;
  }

  #learnTrip(value: number, at: number): number {
    this.#trips = this.#trips.filter((trip) => trip.at > at - TRIP_SPAN && trip.value < value);
    this.#trips.push({ at, value });
    return this.#trips[0]?.value ?? value;
  }

  #learnCost(costPerByte: number, at: number): void {
    const before = this.#costPerByte ?? costPerByte;
    this.#costPerByte = mix(before, costPerByte, ALPHA);
    const slope = (this.#costPerByte - before) / Math.max(1, at - this.#heardAt);
    this.#gradient = mix(this.#gradient, slope, ALPHA);
    this.#heardAt = at;
  }

  #lastThroughput({ arrival, throughput }: Observation): number {
    const duration = arrival.lastByteAt - arrival.firstByteAt;
    return duration >= 2 ? (arrival.sharedBytes * 8000) / duration : (throughput ?? 0);
  }
}

function mix(average: number, value: number, weight: number): number {
  return average + weight * (value - average);
}
