/** The network of a run: held at its first state, played from there, watched meanwhile, and given back. */
import { effect } from "@preact/signals";
import type { Shaper } from "../network/shaper";
import type { LinkSetting, ShaperStatus } from "../wire/shaper";
import type { LinkSample } from "../wire/store";
import { RunFailed } from "./errors";
import { constantLink, type Network, networkLabel, type PlannedRun, UNSHAPED } from "./plan";

/** What was seen of a link: when (performance.now), and how it was. */
export type LinkHistory = readonly { readonly at: number; readonly status: ShaperStatus }[];

export interface RunLink {
  /** Put the network's first state in force, and keep it. */
  hold(): Promise<void>;
  /** Play the held trace from there. How the link is then; null without a shaper. */
  play(): Promise<ShaperStatus | null>;
  /** Back to the shaper's own rate, which is fast. */
  release(): Promise<void>;
}

/** A trace's position may differ by so much from the time that has passed, in milliseconds. */
const JUMP = 1000;
const CONDITIONS = ["down_kbps", "up_kbps", "delay_ms", "jitter_ms", "loss_pct"] as const;

/** The link as it is; or why it cannot be used as that, in one sentence. */
export function presentNetwork(shaper: Shaper | null): Network | string {
  if (shaper === null) return UNSHAPED;
  const status = shaper.status.value;
  if (status === null) return shaper.connectionError.value ?? "The shaper has not told of its link yet.";
  if (status.mode === "playing") {
    return `The trace ${status.trace} plays on the link: choose it as the network, or stop it first.`;
  }
  return constantLink(status.link);
}

/** A run's network; to the link as it is, nothing is done. */
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
        throw new RunFailed(shaper.connectionError.peek() ?? "The shaper has not told of its link yet.");
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

/** What is wrong with the link of a run at one status after another, in one sentence; null if it is what was asked for. */
export function linkProblem(network: Network, before: ShaperStatus, status: ShaperStatus): string | null {
  if (status.closed !== null) return `The link was closed during the run: ${status.closed}`;
  const undisturbed = isAsked(network, status) && (network.trace === null || goesOn(before, status));
  return undisturbed ? null : "Somebody else changed the link during the run.";
}

/** Remembers how the link is until it is told to stop. */
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

/** What was seen while a run lasted, on its own clock. */
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

/** Whether a trace, which begins again at its end, has gone on for as long as time has passed. */
function goesOn(before: ShaperStatus, { time_ms, position_ms, duration_ms }: ShaperStatus): boolean {
  const ahead = (position_ms ?? 0) - (before.position_ms ?? 0) - (time_ms - before.time_ms);
  const duration = duration_ms ?? 0;
  const off = Math.abs(ahead) % duration;
  return Math.min(off, duration - off) <= JUMP;
}
