/**
 * Keeps a transport to the server: connects, notices when the server is lost, and connects again until it is closed.
 * Each attempt reads the server's configuration anew: after a restart its certificate is another one, and only there a server
 * can say that it is full, since browsers do not tell why a session failed.
 */
import pRetry from "p-retry";
import type { ServerConfig } from "../wire/render";
import type { Connected } from "./connect";
import type { Clock } from "./reception";
import { WatchedTransport } from "./watched";

export type ConnectionState =
  | { readonly status: "connecting" }
  | ({ readonly status: "connected" } & Connected)
  | { readonly status: "lost"; readonly reason: string }
  /** The server takes no new viewers; it is asked again by itself. */
  | { readonly status: "full" };

export interface ConnectionOptions {
  readonly fetchConfig: (signal: AbortSignal) => Promise<ServerConfig>;
  readonly connect: (config: ServerConfig, signal: AbortSignal) => Promise<Connected>;
  readonly onState: (state: ConnectionState) => void;
  /** While connected: the server fell silent, or answers again. */
  readonly onSilence: (silent: boolean) => void;
  /** Settles after so many milliseconds; rejects if aborted. */
  readonly sleep: (milliseconds: number, signal: AbortSignal) => Promise<void>;
  readonly now: Clock;
  /** First and longest pause between attempts, in milliseconds. */
  readonly retry?: { readonly minTimeout: number; readonly maxTimeout: number };
  /** From 0 to 1. */
  readonly random?: () => number;
}

/** Those who wait for a full server come back at different times, up to this much later than they were told, as a share of it. */
const JITTER = 0.5;

/** How often an open connection is checked, in milliseconds: a server that died says nothing. */
export const CHECK_EVERY = 3000;
/** How often it is asked whether the server has fallen silent, in milliseconds. */
export const LOOK_EVERY = 250;

/** Runs until the signal aborts, and then closes the transport. */
export async function maintainConnection(options: ConnectionOptions, signal: AbortSignal): Promise<void> {
  const { onState, sleep, now, retry = { minTimeout: 300, maxTimeout: 2000 }, random = Math.random } = options;
  onState({ status: "connecting" });
  while (!signal.aborted) {
    try {
      const { config, connected } = await pRetry(() => attempt(options, signal), {
        ...retry,
        retries: Number.POSITIVE_INFINITY,
        factor: 1.6,
        randomize: true,
        signal,
        shouldRetry: () => !signal.aborted,
        onFailedAttempt: () => onState({ status: "lost", reason: "The server does not answer." }),
      });
      if (connected === null) {
        onState({ status: "full" });
        await sleep(1000 * (config.retry_after_s ?? 0) * (1 + JITTER * random()), signal);
        continue;
      }
      const transport = new WatchedTransport(connected.transport, now);
      onState({ status: "connected", ...connected, transport });
      const reason = await lostReason(config, transport, options, signal);
      transport.close();
      if (!signal.aborted) onState({ status: "lost", reason });
      await sleep(retry.minTimeout, signal);
    } catch (error) {
      if (!signal.aborted) throw error;
    }
  }
}

/** The server's configuration and a transport; null while the server is full. */
async function attempt(
  { fetchConfig, connect }: ConnectionOptions,
  signal: AbortSignal,
): Promise<{ config: ServerConfig; connected: Connected | null }> {
  const config = await fetchConfig(signal);
  if (isFull(config)) return { config, connected: null };
  const connected = await connect(config, signal);
  if (connected.fallback === null) return { config, connected };
  const later = await fetchConfig(signal); // it may have become full just now
  if (!isFull(later)) return { config, connected };
  connected.transport.close();
  return { config: later, connected: null };
}

function isFull({ retry_after_s }: ServerConfig): boolean {
  return typeof retry_after_s === "number";
}

/**
 * Waits until the transport is lost, the server is another one now, or it can be reached and says nothing over the transport.
 * A short outage of the network is none of these: a connection that outlives it is worth more than a new one.
 */
async function lostReason(
  config: ServerConfig,
  transport: WatchedTransport,
  { fetchConfig, sleep, onSilence }: ConnectionOptions,
  signal: AbortSignal,
): Promise<string> {
  const done = new AbortController();
  const until = AbortSignal.any([signal, done.signal]);
  const examine = async (): Promise<string | null> => {
    try {
      const now = await fetchConfig(until);
      return now.certificate_sha256 === config.certificate_sha256 ? null : "The server was started again.";
    } catch {
      until.throwIfAborted();
      return "The server does not answer.";
    }
  };
  const check = async (): Promise<string> => {
    for (;;) {
      await sleep(CHECK_EVERY, until);
      const reason = await examine();
      if (reason !== null) return reason;
    }
  };
  const watch = async (): Promise<string> => {
    for (;;) {
      await sleep(LOOK_EVERY, until);
      if (!transport.silent) continue;
      onSilence(true);
      const probed = transport.probe(sleep, until);
      probed.catch(() => undefined); // aborted; whoever awaits it hears of that
      const reason = await examine();
      if (reason !== null) return reason;
      // It can be reached, maybe only since now.
      if (!(await probed) && !(await transport.probe(sleep, until))) return "The connection fell silent.";
      onSilence(false);
    }
  };
  const watching = [check(), watch()];
  for (const one of watching) one.catch(() => undefined); // aborted once the transport itself was lost
  const aborted = new Promise<string>((resolve) => {
    if (signal.aborted) resolve("");
    signal.addEventListener("abort", () => resolve(""), { once: true });
  });
  try {
    return await Promise.race([transport.lost, ...watching, aborted]);
  } finally {
    done.abort();
    onSilence(false);
  }
}
