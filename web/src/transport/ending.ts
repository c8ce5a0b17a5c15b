/** Waits for the end of a connection: it is lost, the server is another one, or another host of the cluster is to serve us. */
import type { ServerConfig } from "../wire/render";
import { type HostReport, hostReport, sentElsewhere } from "./host-report";
import type { WatchedTransport } from "./watched";

/** How often an open connection is checked, in milliseconds: a server that died says nothing, nor one whose scene was deleted. */
export const CHECK_EVERY = 2000;
/** In a cluster, whose director answers the pages of all hosts. */
export const ASK_DIRECTOR_EVERY = 3000;
/** How often it is asked whether the server has fallen silent, in milliseconds. */
export const LOOK_EVERY = 250;
/** In a cluster this is asked more often: nobody waits for a host that is gone. */
export const LOOK_ELSEWHERE_EVERY = 100;
/** So long after the last answer, in milliseconds, the director of a cluster is asked whether the host is still there. */
export const HOST_PATIENCE = 700;

export interface Ending {
  readonly reason: string;
  /** The configuration that names another host, whose transport replaces this one, which may still work. */
  readonly next?: ServerConfig;
}

export interface WatchOptions {
  readonly fetchConfig: (signal: AbortSignal, report?: HostReport) => Promise<ServerConfig>;
  /** While connected: the server fell silent, or answers again. */
  readonly onSilence: (silent: boolean) => void;
  /** Settles after so many milliseconds; rejects if aborted. */
  readonly sleep: (milliseconds: number, signal: AbortSignal) => Promise<void>;
}

/**
 * Settles when the transport is lost, the server is another one now, or it can be reached and says nothing over the transport;
 * in a cluster also when another host is named. A short outage of the network is none of these: a connection that outlives it is
 * worth more than a new one.
 */
export async function ending(
  config: ServerConfig,
  transport: WatchedTransport,
  { fetchConfig, sleep, onSilence }: WatchOptions,
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
      // Without its director, a host goes on.
      return clustered ? null : { reason: "The server does not answer." };
    }
    if (sentElsewhere(config, now)) return { reason: "Another host serves the scene now.", next: now };
    const same = now.host === config.host && now.certificate_sha256 !== config.certificate_sha256;
    return same ? { reason: "The server was started again." } : null;
  };
  const check = async (): Promise<Ending> => {
    for (;;) {
      await sleep(clustered ? ASK_DIRECTOR_EVERY : CHECK_EVERY, until);
      const end = await examine("at");
      if (end !== null) return end;
    }
  };
  const watch = async (): Promise<Ending> => {
    for (;;) {
      await sleep(LOOK_EVERY, until);
      if (!transport.silent) continue;
      onSilence(true);
      const probed = transport.probe(sleep, until);
      probed.catch(() => undefined); // aborted; whoever awaits it hears of that
      const end = await examine("silent");
      if (end !== null) return end;
      // It can be reached, maybe only since now.
      if (!(await probed) && !(await transport.probe(sleep, until))) return { reason: "The connection fell silent." };
      onSilence(false);
    }
  };
  // Long before it is known whether the host or the network is to blame, another host can have the scene.
  const lookElsewhere = async (): Promise<Ending> => {
    for (;;) {
      await sleep(LOOK_ELSEWHERE_EVERY, until);
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
