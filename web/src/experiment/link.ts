/** The network of a run: held at its first state, played from there, watched meanwhile, and given back. */
import { effect } from "@preact/signals";
import type { Shaper } from "../network/shaper";
import type { LinkSetting, ShaperStatus } from "../wire/shaper";
import type { LinkSample } from "../wire/store";
import { RunFailed } from "./errors";
import { constantLink, type Network, networkLabel, type PlannedRun, UNSHAPED } from "./plan";

/** An observation of a link: its time (performance.now), and its state. */
export type LinkHistory = readonly { readonly at: number; readonly status: ShaperStatus }[];

export interface RunLink {
  /** Put the network's first state in force, and keep it. */
  hold(): Promise<void>;
  /** Play the held trace from there. How the link is then; null without a shaper. */
  play(): Promise<ShaperStatus | null>;
  /** Back to the shaper's own rate, which is fast. */
  release(): Promise<void>;
}

/** Tolerated difference between a trace's position and the elapsed time, in milliseconds. */
const JUMP = 1000;
const CONDITIONS = ["down_kbps", "up_kbps", "delay_ms", "jitter_ms", "loss_pct"] as const;

/** The current link; or the reason why it is unusable, in one sentence. */
export function presentNetwork(shaper: Shaper | null): Network | string {
  if (shaper === null) return UNSHAPED;
  const status = shaper.status.value;
  if (status === null) return shaper.connectionError.value ?? "The shaper has not reported its link yet.";
  if (status.mode === "playing") {
    return `The trace ${status.trace} plays on the link: choose it as the network, or stop it first.`;
  }
  return constantLink(status.link);
}

/** A run's network; the current link is left unchanged. */
export function linkFor(shaper: Shaper | null, { network }: Pick<PlannedRun, "network">): RunLink {
  const { link, trace, rtt_ms, offset_s = 0 } = network;
  if (link === null && trace === null) return { hold: async () => {}, play: async () => null, release: async () => {} };
  if (shaper === null)
    throw new RunFailed(`There is no shaper, so that the network cannot be ${networkLabel(network)}.`);
  const { api } = shaper;
  if (trace === null) {
    const present = () => {
      const status = shaper.status.peek();
      if (status === null)
        throw new RunFailed(shaper.connectionError.peek() ?? "The shaper has not reported its link yet.");
      if (isAsked(network, status)) return status;
      throw new RunFailed(`The link is not ${networkLabel(network)} any more, as it was when the experiment began.`);
    };
    return { hold: async () => void present(), play: async () => present(), release: async () => {} };
  }
  return {
    async hold() {
      await api.start({ trace, loop: true, delay_ms: rtt_ms === null ? null : rtt_ms / 2 });
      await api.pause();
      await api.seek(offset_s * 1000);
    },
    async play() {
      await api.seek(offset_s * 1000);
      return api.resume();
    },
    async release() {
      await api.stop();
    },
  };
}

/** The fault of a run's link in its successive states, in one sentence; null if it is as requested. */
export function linkProblem(network: Network, before: ShaperStatus, status: ShaperStatus): string | null {
  if (status.closed !== null) return `The link was closed during the run: ${status.closed}`;
  const undisturbed = isAsked(network, status) && (network.trace === null || goesOn(before, status));
  return undisturbed ? null : "The link was changed from outside during the run.";
}

/** Records the link's state until stopped. */
export function watchLink(
  shaper: Shaper | null,
  now: () => number,
): { readonly history: LinkHistory; readonly stop: () => void } {
  const history: { at: number; status: ShaperStatus }[] = [];
  const stop = effect(() => {
    const status = shaper?.status.value;
    if (status) history.push({ at: now(), status });
  });
  return { history, stop };
}

/** Observations during a run, on its own clock. */
export function linkSamples(history: LinkHistory, startedAt: number, endedAt: number): LinkSample[] {
  return history
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

function isAsked({ link, trace, rtt_ms }: Network, status: ShaperStatus): boolean {
  if (link !== null) return status.mode !== "playing" && same(link, status.link);
  const delayed = rtt_ms === null || status.link.delay_ms === rtt_ms / 2;
  return status.mode === "playing" && status.trace === trace && delayed;
}

function same(asked: LinkSetting, link: LinkSetting): boolean {
  return CONDITIONS.every((condition) => asked[condition] === link[condition]);
}

/** Whether a looping trace has advanced by the elapsed time. */
function goesOn(before: ShaperStatus, { time_ms, position_ms, duration_ms }: ShaperStatus): boolean {
  const ahead = (position_ms ?? 0) - (before.position_ms ?? 0) - (time_ms - before.time_ms);
  const duration = duration_ms ?? 0;
  const off = Math.abs(ahead) % duration;
  return Math.min(off, duration - off) <= JUMP;
}
