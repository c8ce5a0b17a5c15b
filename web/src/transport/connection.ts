/**
 * Keeps a transport to the server: connects, notices when the server is lost, and connects again until it is closed.
 * Each attempt reads the server's configuration anew: after a restart its certificate is another one.
 */
import pRetry from "p-retry";
import type { ServerConfig } from "../wire/render";
import type { Connected } from "./connect";

export type ConnectionState =
  | { readonly status: "connecting" }
  | ({ readonly status: "connected" } & Connected)
  | { readonly status: "lost"; readonly reason: string };

export interface ConnectionOptions {
  readonly fetchConfig: (signal: AbortSignal) => Promise<ServerConfig>;
  readonly connect: (config: ServerConfig, signal: AbortSignal) => Promise<Connected>;
  readonly onState: (state: ConnectionState) => void;
  /** Settles after so many milliseconds; rejects if aborted. */
  readonly sleep: (milliseconds: number, signal: AbortSignal) => Promise<void>;
  /** First and longest pause between attempts, in milliseconds. */
  readonly retry?: { readonly minTimeout: number; readonly maxTimeout: number };
}

/** How often an open connection is checked, in milliseconds: a server that died says nothing. */
export const CHECK_EVERY = 3000;

/** Runs until the signal aborts, and then closes the transport. */
export async function maintainConnection(options: ConnectionOptions, signal: AbortSignal): Promise<void> {
  const { fetchConfig, connect, onState, sleep, retry = { minTimeout: 300, maxTimeout: 4000 } } = options;
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
      onState({ status: "connected", ...connected });
      const reason = await lostReason(config, connected, options, signal);
      connected.transport.close();
      if (!signal.aborted) onState({ status: "lost", reason });
      await sleep(retry.minTimeout, signal);
    } catch (error) {
      if (!signal.aborted) throw error;
    }
  }
}

/** Waits until the transport is lost, or a look at the server's configuration shows that it is another server now. */
async function lostReason(
  config: ServerConfig,
  { transport }: Connected,
  { fetchConfig, sleep }: ConnectionOptions,
  signal: AbortSignal,
): Promise<string> {
  const done = new AbortController();
  const until = AbortSignal.any([signal, done.signal]);
  const check = async (): Promise<string> => {
    for (;;) {
      await sleep(CHECK_EVERY, until);
      try {
        const now = await fetchConfig(until);
        if (now.certificate_sha256 !== config.certificate_sha256) return "The server was started again.";
      } catch {
        until.throwIfAborted();
        return "The server does not answer.";
      }
    }
  };
  const checked = check();
  checked.catch(() => undefined); // aborted once the transport itself was lost
  const aborted = new Promise<string>((resolve) => {
    if (signal.aborted) resolve("");
    signal.addEventListener("abort", () => resolve(""), { once: true });
  });
  try {
    return await Promise.race([transport.lost, checked, aborted]);
  } finally {
    done.abort();
  }
}
