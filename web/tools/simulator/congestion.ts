/**
 * Congestion control and pacing of one QUIC connection, as in the render service
 * (services/render/tigas_render/transport): NewReno (RFC 9002, appendix B) that leaves slow start when round trips
 * grow, with a window that only grows for packets sent while it was full, and never falls below the path's capacity; and a
 * pacer of 1.25 windows per round trip in ticks of a millisecond.
 */

/** Bytes of UDP payload in a full packet. */
export const PACKET = 1452;
const INITIAL_WINDOW = 10 * PACKET;
const MIN_WINDOW = 2 * PACKET;

export interface Packet {
  readonly number: number;
  /** Bytes of UDP payload. */
  readonly bytes: number;
  readonly sentAt: number;
}

export class NewReno {
  readonly #trips = new RoundTrips();
  #window = INITIAL_WINDOW;
  #threshold: number | null = null;
  #inFlight = 0;
  #recoverySince = Number.NEGATIVE_INFINITY;
  /** Number of the last packet that left no room for another. */
  #fullAt = -1;
  #stash = 0;

  get window(): number {
    return this.#window;
  }

  get room(): boolean {
    return this.#inFlight + PACKET <= this.#window;
  }

  sent({ number, bytes }: Packet): void {
    this.#inFlight += bytes;
    if (!this.room) this.#fullAt = number;
  }

  acknowledged({ number, bytes, sentAt }: Packet): void {
    this.#inFlight -= bytes;
    if (sentAt <= this.#recoverySince || number > this.#fullAt) return;
    if (this.#threshold === null || this.#window < this.#threshold) {
      this.#window += bytes;
    } else {
      this.#stash += bytes;
      if (this.#stash >= this.#window) {
        this.#stash -= this.#window;
        this.#window += PACKET;
      }
    }
  }

  /** `shrinks` says whether the window does. */
  lost({ bytes, sentAt }: Packet, now: number, shrinks = true): void {
    this.#inFlight -= bytes;
    if (sentAt <= this.#recoverySince) return;
    this.#recoverySince = now;
    if (!shrinks) return;
    this.#window = Math.max(MIN_WINDOW, Math.floor(this.#window / 2));
    this.#threshold = this.#window;
  }

  /** Sets a window larger than the one after a loss. */
  keep(window: number): void {
    this.#window = Math.max(this.#window, window);
    this.#threshold = this.#window;
  }

  /** Records a measured round trip. */
  measured(roundTrip: number, now: number): void {
    if (this.#threshold === null && this.#trips.growing(roundTrip, now)) this.#threshold = this.#window;
  }
}

const BANDWIDTH_MS = 2000;
const ROUND_TRIP_MS = 10_000;
const LEAST_INTERVAL_MS = 2;
const MOST_LOSS = 0.06;
const MEMORY = 500;
const LEAST_PACKETS = 50;
const LOSSY_MS = 2000;
const QUEUE = 1.25;

interface Sample {
  readonly delivered: number;
  readonly deliveredAt: number;
  readonly firstSentAt: number;
}

/**
 * NewReno that tolerates random loss (westwood.py): its window falls to bandwidth · minimum round trip or to half, and not at
 * all without a queue.
 */
export class Westwood {
  readonly #reno = new NewReno();
  readonly #bandwidth = new Greatest(BANDWIDTH_MS);
  /** The minimum round trip, as the maximum of negative ones. */
  readonly #shortest = new Greatest(ROUND_TRIP_MS);
  readonly #samples = new Map<number, Sample>();
  #delivered = 0;
  #deliveredAt = 0;
  #firstSentAt = 0;
  #acknowledged = 0;
  #lost = 0;
  #lostAt = Number.NEGATIVE_INFINITY;
  #roundTrip = Number.POSITIVE_INFINITY;

  get window(): number {
    return this.#reno.window;
  }

  get room(): boolean {
    return this.#reno.room;
  }

  sent(packet: Packet): void {
    if (this.#samples.size === 0) this.#deliveredAt = this.#firstSentAt = packet.sentAt;
    this.#samples.set(packet.number, {
      delivered: this.#delivered,
      deliveredAt: this.#deliveredAt,
      firstSentAt: this.#firstSentAt,
    });
    this.#reno.sent(packet);
  }

  acknowledged(packet: Packet, now: number): void {
    this.#delivered += packet.bytes;
    this.#deliveredAt = now;
    this.#acknowledged = this.#acknowledged * (1 - 1 / MEMORY) + 1;
    this.#lost *= 1 - 1 / MEMORY;
    const sample = this.#samples.get(packet.number);
    if (sample !== undefined) {
      this.#samples.delete(packet.number);
      this.#firstSentAt = packet.sentAt;
      const interval = Math.max(packet.sentAt - sample.firstSentAt, now - sample.deliveredAt);
      if (interval > LEAST_INTERVAL_MS) this.#bandwidth.add((this.#delivered - sample.delivered) / interval, now);
    }
    this.#reno.acknowledged(packet);
  }

  lost(packet: Packet, now: number): void {
    this.#samples.delete(packet.number);
    this.#lost++;
    this.#lostAt = now;
    const [bandwidth, shortest] = [this.#bandwidth.value, this.#shortest.value];
    const known = bandwidth !== undefined && shortest !== undefined;
    const before = this.#reno.window;
    this.#reno.lost(packet, now, !known || this.#queue || this.#congested);
    if (this.#reno.window >= before || this.#congested || !known) return;
    this.#reno.keep(Math.min(before, Math.floor(bandwidth * -shortest)));
  }

  /** Whether data is worth sending twice: packets were lost recently although the path has no queue. */
  wantsCopies(now: number): boolean {
    return now - this.#lostAt < LOSSY_MS && !this.#queue && !this.#congested;
  }

  get #queue(): boolean {
    const shortest = this.#shortest.value;
    return shortest === undefined || this.#roundTrip > QUEUE * -shortest;
  }

  get #congested(): boolean {
    return this.#acknowledged > LEAST_PACKETS && this.#lost > MOST_LOSS * this.#acknowledged;
  }

  /** Records a measured round trip; `delay` is how long the page held the acknowledgement. */
  measured(roundTrip: number, now: number, delay = 0): void {
    this.#roundTrip = roundTrip - delay;
    this.#shortest.add(-roundTrip, now);
    this.#reno.measured(roundTrip, now);
  }
}

/** The maximum of the values of the last milliseconds. */
class Greatest {
  readonly #span: number;
  readonly #values: { readonly at: number; readonly value: number }[] = [];

  constructor(span: number) {
    this.#span = span;
  }

  get value(): number | undefined {
    return this.#values[0]?.value;
  }

  add(value: number, now: number): void {
    while ((this.#values.at(-1)?.value ?? Number.POSITIVE_INFINITY) <= value) this.#values.pop();
    this.#values.push({ at: now, value });
    while ((this.#values[0]?.at ?? now) < now - this.#span) this.#values.shift();
  }
}

/** Whether the round trip grows (aioquic's QuicRttMonitor): the minimum of five has been a quarter above the best, five times. */
class RoundTrips {
  static readonly SIZE = 5;
  #samples: number[] = [];
  #sampledAt = Number.NEGATIVE_INFINITY;
  #best = Number.POSITIVE_INFINITY;
  #times = 0;

  growing(roundTrip: number, now: number): boolean {
    if (now <= this.#sampledAt + 1) return false;
    this.#sampledAt = now;
    this.#samples = [...this.#samples, roundTrip].slice(-RoundTrips.SIZE);
    if (this.#samples.length < RoundTrips.SIZE) return false;
    this.#best = Math.min(this.#best, Math.max(...this.#samples));
    const above = Math.min(...this.#samples) - this.#best;
    if (above * 4 >= this.#best) this.#times++;
    else if (above > 0) this.#times = 0;
    return this.#times >= RoundTrips.SIZE;
  }
}

const GAIN = 1.25;
const TICK = 1;
const MAX_IDLE_BURST = 16 * PACKET;

/** Spreads a window over a round trip, in milliseconds' worth of packets; inactive until a round trip is known. */
export class Pacer {
  #each = 0;
  #most = 0;
  #credit = 0;
  #at = 0;

  update(window: number, roundTrip: number): void {
    const rate = (GAIN * window) / Math.max(0.001, roundTrip);
    const burst = Math.max(2 * PACKET, Math.min(window / 4, MAX_IDLE_BURST));
    this.#each = PACKET / rate;
    this.#most = Math.max(burst / rate, 2 * TICK);
    this.#credit = Math.min(this.#credit, this.#most);
  }

  /** Earliest time at which the next packet may leave. */
  next(now: number): number {
    this.#credit = Math.min(this.#credit + now - this.#at, this.#most);
    this.#at = now;
    return this.#each > 0 && this.#credit <= 0 ? now + Math.max(this.#each, TICK) : now;
  }

  sent(): void {
    this.#credit = Math.max(0, this.#credit - this.#each);
  }
}
