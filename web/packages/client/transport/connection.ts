/**
 * Maintains a transport to the server: connects, notices a lost server, and reconnects until closed. Each attempt reads
 * the server's configuration again: a restarted server has another certificate, and only the configuration can say that
 * the server is full, since browsers do not report why a session failed. In a cluster it names the host to use,
 * including a replacement.
 */
import { retry, sleep } from "../async/retry";
import type { ServerConfig } from "../wire/render";
import type { Connected } from "./connect";
import { ending, type WatchOptions } from "./ending";
import { type HostReport, hostReport, isFull, sentElsewhere } from "./host-report";
import type { Clock } from "./reception";
import { WatchedTransport } from "./watched";

export type ConnectionState =
  | { readonly status: "connecting" }
  /** Also reported when a transport replaces another; the old one is closed after this call. */
  | ({ readonly status: "connected" } & Connected)
  | { readonly status: "lost"; readonly reason: string }
  /** The server takes no new viewers; the client retries automatically. */
  | { readonly status: "full" };

export interface ConnectionOptions extends WatchOptions {
  readonly connect: (config: ServerConfig, signal: AbortSignal) => Promise<Connected>;
  readonly onState: (state: ConnectionState) => void;
  readonly now: Clock;
}

/** First and longest pause between attempts, in milliseconds. */
const PAUSES = { minTimeout: 300, maxTimeout: 2000 };
/** Viewers of a full server retry at different times: up to this much later than announced, as a share of the delay. */
const JITTER = 0.5;
/** A connection that lasted less than this, in milliseconds, is not replaced at once: something is wrong. */
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
  const { onState, now } = options;
  /**
   * Knowledge carried into the next attempt: the host that failed, the configuration that names another, or the last
   * configuration.
   */
  let report: HostReport | undefined;
  let next: ServerConfig | undefined;
  let last: ServerConfig | undefined;
  /** The transport in use until another replaces it. */
  let previous: WatchedTransport | undefined;
  onState({ status: "connecting" });
  while (!signal.aborted) {
    try {
      const known = { report, next, last };
      const { config, connected } = await retry(() => attempt(options, known, signal), {
        ...PAUSES,
        factor: 1.6,
        signal,
        onFailedAttempt: () => {
          next = undefined;
          onState({ status: "lost", reason: "The server is not responding." });
        },
      });
      report = next = undefined;
      if (connected === null) {
        onState({ status: "full" });
        previous?.close();
        await sleep(1000 * (config.retry_after_s ?? 0) * (1 + JITTER * Math.random()), signal);
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
      await sleep(PAUSES.minTimeout, signal);
    } catch (error) {
      if (!signal.aborted) throw error;
    }
  }
  previous?.close();
}

/** The server's configuration and a transport, in a cluster to the first host that can be reached. */
async function attempt(
  { fetchConfig, connect, visible }: ConnectionOptions,
  { report, next, last }: Known,
  signal: AbortSignal,
): Promise<Attempt> {
  await visible(signal);
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

/** Without its director, the host of a cluster may still be reachable. */
function orElse(last: ServerConfig | undefined, signal: AbortSignal): (error: unknown) => ServerConfig {
  return (error) => {
    if (last === undefined || signal.aborted) throw error;
    return last;
  };
}
