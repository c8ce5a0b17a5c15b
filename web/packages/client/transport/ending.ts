/**
 * Waits for the end of a connection: it is lost, the server was replaced, or another host of the cluster takes over.
 */
import { sleep } from "../async/retry";
import type { ServerConfig } from "../wire/render";
import { type HostReport, hostReport, sentElsewhere } from "./host-report";
import type { WatchedTransport } from "./watched";

/**
 * Interval of checks on an open connection, in milliseconds: neither a dead server nor one with a deleted scene sends anything.
 */
export const CHECK_EVERY = 2000;
/** The same in a cluster, where the director answers the pages of all hosts. */
export const ASK_DIRECTOR_EVERY = 3000;
/** Interval of checks for a silent server, in milliseconds. */
export const LOOK_EVERY = 250;
/** The same in a cluster, where another host can take over at once. */
export const LOOK_ELSEWHERE_EVERY = 100;
/** Time after the last answer until the director is asked about the host, in milliseconds. */
export const HOST_PATIENCE = 700;

export interface Ending {
  readonly reason: string;
  /** The configuration of another host; its transport replaces this one, which may still work. */
  readonly next?: ServerConfig;
}

export interface WatchOptions {
  readonly fetchConfig: (signal: AbortSignal, report?: HostReport) => Promise<ServerConfig>;
  /** Called while connected when the server stops answering, or answers again. */
  readonly onSilence: (silent: boolean) => void;
  /** Settles once the page is visible, because a hidden page sends no requests. Rejects if aborted. */
  readonly visible: (signal: AbortSignal) => Promise<void>;
}

/**
 * Settles when the transport is lost, the server was replaced, or the server is reachable but silent on the transport;
 * in a cluster also when another host is named. A short network outage is none of these: a connection that survives it
 * is worth more than a new one.
 */
export async function ending(
  config: ServerConfig,
  transport: WatchedTransport,
  { fetchConfig, visible, onSilence }: WatchOptions,
  signal: AbortSignal,
): Promise<Ending> {
  const clustered = hostReport("at", config) !== undefined;
  const done = new AbortController();
  const until = AbortSignal.any([signal, done.signal]);
  const examine = async (how: "at" | "silent"): Promise<Ending | null> => {
    let now: ServerConfig;
    try {
      now = await fetchConfig(until, hostReport(how, config));
    } catch {
      until.throwIfAborted();
      // A host continues without its director.
      return clustered ? null : { reason: "The server is not responding." };
    }
    if (sentElsewhere(config, now)) return { reason: "Another host now serves the scene.", next: now };
    const same = now.host === config.host && now.certificate_sha256 !== config.certificate_sha256;
    return same ? { reason: "The server was restarted." } : null;
  };
  const check = async (): Promise<Ending> => {
    for (;;) {
      await sleep(clustered ? ASK_DIRECTOR_EVERY : CHECK_EVERY, until);
      await visible(until);
      const end = await examine("at");
      if (end !== null) return end;
    }
  };
  const watch = async (): Promise<Ending> => {
    for (;;) {
      await sleep(LOOK_EVERY, until);
      await visible(until);
      if (!transport.silent) continue;
      onSilence(true);
      const probed = transport.probe(until);
      probed.catch(() => undefined); // aborted; reported where it is awaited
      const end = await examine("silent");
      if (end !== null) return end;
      // It can be reached, perhaps only just now.
      if (!(await probed) && !(await transport.probe(until))) return { reason: "The connection stopped responding." };
      onSilence(false);
    }
  };
  // Another host can have the scene long before it is known whether the host or the network is to blame.
  const lookElsewhere = async (): Promise<Ending> => {
    for (;;) {
      await sleep(LOOK_ELSEWHERE_EVERY, until);
      await visible(until);
      if (transport.quietFor <= HOST_PATIENCE) continue;
      const end = await examine("silent");
      if (end !== null) return end;
      await sleep(HOST_PATIENCE, until);
    }
  };
  const watching = [check(), watch(), ...(clustered ? [lookElsewhere()] : [])];
  for (const one of watching) one.catch(() => undefined); // aborted once the transport itself was lost
  const aborted = new Promise<Ending>((resolve) => {
    if (signal.aborted) resolve({ reason: "" });
    signal.addEventListener("abort", () => resolve({ reason: "" }), { once: true });
  });
  const lost = transport.lost.then((reason) => ({ reason }));
  try {
    return await Promise.race([lost, ...watching, aborted]);
  } finally {
    done.abort();
    onSilence(false);
  }
}
