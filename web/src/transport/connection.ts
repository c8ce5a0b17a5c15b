/**
 * Keeps a transport to the server: connects, notices when the server is lost, and connects again until it is closed.
 * Each attempt reads the server's configuration anew: after a restart its certificate is another one.
 */
import pRetry from "p-retry";
import type { ServerConfig } from "../wire/render";
import type { Connected } from "./connect";
import type { Clock } from "./reception";
import { WatchedTransport } from "./watched";

export type ConnectionState =
  | { readonly status: "connecting" }
  | ({ readonly status: "connected" } & Connected)
  | { readonly status: "lost"; readonly reason: string };

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
}

/** How often an open connection is checked, in milliseconds: a server that died says nothing. */
export const CHECK_EVERY = 3000;
/** How often it is asked whether the server has fallen silent, in milliseconds. */
export const LOOK_EVERY = 250;

/** Runs until the signal aborts, and then closes the transport. */
export async function maintainConnection(options: ConnectionOptions, signal: AbortSignal): Promise<void> {
  const { fetchConfig, connect, onState, sleep, now, retry = { minTimeout: 300, maxTimeout: 2000 } } = options;
  onState({ status: "connecting" });
  while (!signal.aborted) {
    try {
      const { config, connected } = await pRetry(
        async () => {
          const config = await fetchConfig(signal);
          return { config, connected: await connect(config, signal) };
        },
        {
          ...retry,
          retries: Number.POSITIVE_INFINITY,
          factor: 1.6,
          randomize: true,
          signal,
          shouldRetry: () => !signal.aborted,
          onFailedAttempt: () => onState({ status: "lost", reason: "The server does not answer." }),
        },
      );
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
