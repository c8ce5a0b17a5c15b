/** The network of a run: played from before the run's part of its trace, watched meanwhile, and released. */
import { effect } from "@preact/signals";
import { LINK_TERMS, UNSHAPED } from "#client/wire/run";
import type { LinkSetting, ShaperStatus } from "#client/wire/shaper";
import type { Configuration, LinkSample } from "#client/wire/store";
import type { Shaper } from "../network/shaper";
import { RunFailed } from "./errors";

type Network = Configuration["network"];

/** Seconds before the warm-up at which a trace starts: a viewer that opens during an outage may never be ready. */
const OPENING = 10;
/** Tolerated difference between a trace's position and the elapsed time, in milliseconds. */
const JUMP = 1000;
/** A shaper reports its link five times per second; without a report for this many milliseconds it counts as lost. */
const SILENCE = 2000;
const CONDITIONS = ["down_kbps", "up_kbps", "delay_ms", "jitter_ms", "loss_pct"] as const;

export class RunLink {
  readonly #shaper: Shaper | null;
  readonly #network: Network;
  /** The last state in which the link was known to be right. */
  #known: ShaperStatus | null = null;
  readonly #seen: { readonly at: number; readonly status: ShaperStatus }[] = [];

  readonly #warmUp: number;

  /** Without a shaper, the network must be unshaped. The warm-up is in seconds. */
  constructor(shaper: Shaper | null, network: Network, warmUp: number) {
    if (shaper === null && (network.link || network.trace)) {
      throw new RunFailed("This server has no network shaper, so the network must be “unshaped”.");
    }
    this.#shaper = shaper;
    this.#network = network;
    this.#warmUp = warmUp;
  }

  /** Applies the network, for the viewer to start in. */
  async begin(): Promise<void> {
    if (this.#shaper === null) return;
    const { api } = this.#shaper;
    const { link, trace, rtt_ms } = this.#network;
    if (link) this.#known = await api.link(link);
    else if (trace) {
      this.#known = await api.start({ trace, loop: true, delay_ms: rtt_ms == null ? null : rtt_ms / 2 });
      await this.#seek(this.#warmUp + OPENING);
    } else this.#known = await api.stop();
  }

  /** Plays the trace from where the warm-up begins. */
  warmUp(): Promise<void> {
    return this.#seek(this.#warmUp);
  }

  /** Plays the trace from where the movement begins. */
  play(): Promise<void> {
    return this.#seek(0);
  }

  /** Records the link until stopped, and reports the first fault in one sentence. */
  watch(now: () => number, onProblem: (sentence: string) => void): () => void {
    const shaper = this.#shaper;
    if (shaper === null) return () => undefined;
    return effect(() => {
      const status = shaper.status.value;
      const problem = status === null ? shaper.connectionError.value : this.#problem(status);
      if (status) this.#seen.push({ at: now(), status });
      if (problem !== null) onProblem(problem);
    });
  }

  /** Whether the shaper still reports its link. */
  reports(now: number): boolean {
    return this.#shaper === null || now - (this.#seen.at(-1)?.at ?? 0) <= SILENCE;
  }

  /** Observations of a run, on its own clock. */
  samples(startedAt: number, endedAt: number): LinkSample[] {
    return this.#seen
      .filter(({ at }) => at >= startedAt && at <= endedAt)
      .map(({ at, status: { position_ms, down, up } }) => ({
        at: at - startedAt,
        position_ms,
        target_kbps: down.target_kbps,
        delivered_kbps: down.delivered_kbps,
        queue_ms: down.queue_ms,
        drops: down.drops,
        up_delivered_kbps: up.delivered_kbps,
      }));
  }

  get backend(): ShaperStatus["backend"] | null {
    return this.#known?.backend ?? null;
  }

  /** Returns to the shaper's default rate, which is fast. */
  async release(): Promise<void> {
    await this.#shaper?.api.stop();
  }

  /** Does the same while the page unloads. */
  abandon(): void {
    this.#shaper?.api.abandon();
  }

  /** Plays from `before` seconds before the run's part, wrapping around the trace's start. */
  async #seek(before: number): Promise<void> {
    if (this.#shaper === null || !this.#network.trace) return;
    const position = ((this.#network.offset_s ?? 0) - before) * 1000;
    const duration = this.#known?.duration_ms || 1;
    this.#known = await this.#shaper.api.seek(position - duration * Math.floor(position / duration));
  }

  #problem(status: ShaperStatus): string | null {
    const before = this.#known;
    if (before === null || status.time_ms <= before.time_ms) return null; // reported before the link was as requested
    this.#known = status;
    if (status.closed !== null) return `The link was closed during the run: ${status.closed}`;
    return this.#leftAlone(before, status) ? null : "The link was changed from outside during the run.";
  }

  #leftAlone(before: ShaperStatus, status: ShaperStatus): boolean {
    if (status.trace !== before.trace) return false;
    if (!this.#network.trace) return CONDITIONS.every((condition) => status.link[condition] === before.link[condition]);
    const delayed = this.#network.rtt_ms == null || status.link.delay_ms === before.link.delay_ms;
    return status.mode === "playing" && delayed && goesOn(before, status);
  }
}

/** The current link in the form of experiment files, such as `20mbit,20ms-rtt`; or why it is unusable, in `problem`. */
export function presentNetwork(shaper: Shaper | null): { readonly label: string } | { readonly problem: string } {
  if (shaper === null) return { label: UNSHAPED };
  const status = shaper.status.value;
  if (status === null) {
    return { problem: shaper.connectionError.value ?? "The shaper has not reported its link yet." };
  }
  if (status.mode === "playing") {
    return { problem: `The trace ${status.trace} is playing on the link: choose it as the network, or stop it first.` };
  }
  return { label: networkLabel(status.link) };
}

/** A constant link's label; defaults are omitted. */
export function networkLabel(link: LinkSetting): string {
  const terms = LINK_TERMS.map(({ field, ...term }) => ({ ...term, value: link[field] ?? 0 }));
  const said = terms.filter(({ value, usual }) => value !== usual);
  return said.map(({ value, scale, unit }) => `${Number((value / scale).toPrecision(6))}${unit}`).join();
}

/** Whether a looping trace has advanced by the elapsed time. */
function goesOn(before: ShaperStatus, { time_ms, position_ms, duration_ms }: ShaperStatus): boolean {
  const ahead = (position_ms ?? 0) - (before.position_ms ?? 0) - (time_ms - before.time_ms);
  const duration = duration_ms ?? 0;
  const off = Math.abs(ahead) % duration;
  return Math.min(off, duration - off) <= JUMP;
}
