/** Picks the transport: WebTransport if available, fetch otherwise, with the reason for a fallback. */
import type { ServerConfig } from "../wire/render";
import { FetchTransport } from "./fetch";
import { hostUrl } from "./host-url";
import type { Clock } from "./reception";
import { openSession } from "./session";
import { StreamTransport } from "./streams";
import type { FrameTransport, TransportKind } from "./transport";

/** `auto` is WebTransport streams, then fetch. */
export type TransportChoice = "auto" | TransportKind;

export interface Connected {
  readonly transport: FrameTransport;
  /** Reason for falling back, or null. */
  readonly fallback: string | null;
  /** The session was refused: another host may accept it. */
  readonly refused?: boolean;
  /** The host's name, in a cluster. */
  readonly host: string | null;
}

const SESSION_TIMEOUT = 3000;

/** Rejects only if aborted: fetch needs no connecting. */
export async function connect(
  config: Pick<ServerConfig, "webtransport_url" | "certificate_sha256" | "host" | "render_url">,
  choice: TransportChoice,
  signal: AbortSignal,
  now: Clock,
  open: typeof openSession = openSession,
): Promise<Connected> {
  const host = config.host ?? null;
  const byFetch = (fallback: string | null): Connected => ({
    transport: new FetchTransport(now, hostUrl("render", config)),
    fallback,
    host,
  });
  if (choice === "fetch") return byFetch(null);
  if (!globalThis.isSecureContext) return byFetch("this page is not a secure context");
  if (typeof globalThis.WebTransport !== "function") return byFetch("this browser has no WebTransport");
  if (config.webtransport_url === null) return byFetch("the server offers no WebTransport");
  try {
    const session = await open(
      { url: config.webtransport_url, certificateSha256: config.certificate_sha256, timeout: SESSION_TIMEOUT },
      signal,
    );
    const datagrams = choice === "webtransport-datagrams";
    const Transport = datagrams ? (await import("./datagrams")).DatagramTransport : StreamTransport;
    return { transport: new Transport(session, now), fallback: null, host };
  } catch (error) {
    signal.throwIfAborted();
    return { ...byFetch(error instanceof Error ? error.message : String(error)), refused: true };
  }
}
