/**
 * Keeps a transport to the server: connects, notices when the server is lost, and connects again until it is closed.
 * Each attempt reads the server's configuration anew: after a restart its certificate is another one, and only there a server
 * can say that it is full, since browsers do not tell why a session failed. In a cluster it names the host that is to serve us,
 * and says at once if that is another one.
 */
import pRetry from "p-retry";
import type { ServerConfig } from "../wire/render";
import type { Connected } from "./connect";
import { ending, type WatchOptions } from "./ending";
import { type HostReport, hostReport, isFull, sentElsewhere } from "./host-report";
import type { Clock } from "./reception";
import { WatchedTransport } from "./watched";

export type ConnectionState =
  | { readonly status: "connecting" }
  /** Also of a transport that replaces one: the other is closed when this has been told. */
  | ({ readonly status: "connected" } & Connected)
  | { readonly status: "lost"; readonly reason: string }
  /** The server takes no new viewers; it is asked again by itself. */
  | { readonly status: "full" };

export interface ConnectionOptions extends WatchOptions {
  readonly connect: (config: ServerConfig, signal: AbortSignal) => Promise<Connected>;
  readonly onState: (state: ConnectionState) => void;
  readonly now: Clock;
  /** First and longest pause between attempts, in milliseconds. */
  readonly retry?: { readonly minTimeout: number; readonly maxTimeout: number };
  /** From 0 to 1. */
  readonly random?: () => number;
}

/** Those who wait for a full server come back at different times, up to this much later than they were told, as a share of it. */
const JITTER = 0.5;
/** A connection that lasted for less, in milliseconds, is not replaced at once: something is wrong there. */
const LASTING = 1000;

interface Attempt {
  readonly config: ServerConfig;
  /** Null while the server is full. */
  readonly connected: Connected | null;
}

interface Known {
  readonly report: HostReport | undefined;
  readonly next: ServerConfig | undefined;
  readonly last: ServerConfig | undefined;
}

/** Runs until the signal aborts, and then closes the transport. */
export async function maintainConnection(options: ConnectionOptions, signal: AbortSignal): Promise<void> {
  const { onState, sleep, now, retry = { minTimeout: 300, maxTimeout: 2000 }, random = Math.random } = options;
  /** What is known when another attempt begins: the host that failed, the configuration that names another, or that of the host. */
  let report: HostReport | undefined;
  let next: ServerConfig | undefined;
  let last: ServerConfig | undefined;
  /** The transport that is shown until another takes its place. */
  let previous: WatchedTransport | undefined;
  onState({ status: "connecting" });
  while (!signal.aborted) {
    try {
      const { config, connected } = await pRetry(() => attempt(options, { report, next, last }, signal), {
        ...retry,
        retries: Number.POSITIVE_INFINITY,
        factor: 1.6,
        randomize: true,
        signal,
        shouldRetry: () => !signal.aborted,
        onFailedAttempt: () => {
          next = undefined;
          onState({ status: "lost", reason: "The server does not answer." });
        },
      });
      report = next = undefined;
      if (connected === null) {
        onState({ status: "full" });
        previous?.close();
        await sleep(1000 * (config.retry_after_s ?? 0) * (1 + JITTER * random()), signal);
        continue;
      }
      const transport = new WatchedTransport(connected.transport, now);
      const since = now();
      onState({ status: "connected", ...connected, transport });
      previous?.close();
      previous = transport;
      const end = await ending(config, transport, options, signal);
      next = end.next;
      report = hostReport("silent", config);
      last = report && config;
      if (signal.aborted || next !== undefined) continue;
      if (report !== undefined && now() - since >= LASTING) continue;
      transport.close();
      onState({ status: "lost", reason: end.reason });
      await sleep(retry.minTimeout, signal);
    } catch (error) {
      if (!signal.aborted) throw error;
    }
  }
  previous?.close();
}

/** The server's configuration and a transport, in a cluster to the first host that can be reached. */
async function attempt(
  { fetchConfig, connect }: ConnectionOptions,
  { report, next, last }: Known,
  signal: AbortSignal,
): Promise<Attempt> {
  const tried = new Set<string | null | undefined>();
  let config = next ?? (await fetchConfig(signal, report).catch(orElse(last, signal)));
  for (;;) {
    if (isFull(config)) return { config, connected: null };
    tried.add(config.host);
    const connected = await connect(config, signal);
    if (connected.fallback === null) return { config, connected };
    // It may have become full just now.
    const later = await fetchConfig(signal, hostReport(connected.refused ? "lost" : "at", config)).catch(
      (error: unknown) => {
        connected.transport.close();
        throw error;
      },
    );
    if (!isFull(later) && (tried.has(later.host) || !sentElsewhere(config, later))) return { config, connected };
    connected.transport.close();
    config = later;
  }
}

/** Without its director, the host of a cluster can still be there. */
function orElse(last: ServerConfig | undefined, signal: AbortSignal): (error: unknown) => ServerConfig {
  return (error) => {
    if (last === undefined || signal.aborted) throw error;
    return last;
  };
}
