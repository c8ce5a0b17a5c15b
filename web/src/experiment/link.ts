/** The network of a run: held at its first state, played from there, watched meanwhile, and given back. */
import { effect } from "@preact/signals";
import type { Shaper } from "../network/shaper";
import type { ShaperStatus } from "../shaper-wire";
import type { LinkSample } from "../store-wire";
import { RunFailed } from "./errors";
import type { PlannedRun } from "./plan";

/** What was seen of a link: when (performance.now), and how it was. */
export type Seen = readonly { readonly at: number; readonly status: ShaperStatus }[];

export interface RunLink {
  /** Put the network's first state in force, and keep it. */
  hold(): Promise<void>;
  /** Play the held trace from its start. */
  play(): Promise<void>;
  /** Back to the shaper's own rate, which is fast. */
  release(): Promise<void>;
}

/** A run's network; for the link as it is, nothing is done. */
export function linkFor(shaper: Shaper | null, { network }: Pick<PlannedRun, "network">): RunLink {
  if (network.name === "unshaped") return { hold: async () => {}, play: async () => {}, release: async () => {} };
  if (shaper === null) throw new RunFailed("There is no shaper that could play the network's trace.");
  const { api } = shaper;
  return {
    async hold() {
      const delay_ms = network.rtt_ms === null ? null : network.rtt_ms / 2;
      await api.start({ trace: network.name, loop: true, delay_ms });
      await api.pause();
      await api.seek(0);
    },
    async play() {
      await api.seek(0);
      await api.resume();
    },
    async release() {
      await api.stop();
    },
  };
}

/** Remembers how the link is until it is told to stop. */
export function watchLink(
  shaper: Shaper | null,
  now: () => number,
): { readonly seen: Seen; readonly stop: () => void } {
  const seen: { at: number; status: ShaperStatus }[] = [];
  const stop = effect(() => {
    const status = shaper?.status.value;
    if (status) seen.push({ at: now(), status });
  });
  return { seen, stop };
}

/** What was seen while a run lasted, on its own clock. */
export function linkSamples(seen: Seen, startedAt: number, endedAt: number): LinkSample[] {
  return seen
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
