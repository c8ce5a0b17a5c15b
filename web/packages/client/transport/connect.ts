/** Picks the transport: WebTransport if available, fetch otherwise, with the reason for a fallback. */
import type { ServerConfig } from "../wire/render";
import { FetchTransport } from "./fetch";
import { hostUrl } from "./host-report";
import type { Clock } from "./reception";
import type { SessionOptions } from "./session";
import type { DecodedImage, FrameTransport, TransportKind } from "./transport";

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

/** Sessions and decoding outside the page's main thread (`FrameWorker`). */
export interface FrameBackend {
  open(kind: Exclude<TransportKind, "fetch">, options: SessionOptions, signal: AbortSignal): Promise<FrameTransport>;
  decode(image: Blob): Promise<DecodedImage>;
}

const SESSION_TIMEOUT = 3000;

/** Rejects only if aborted: fetch needs no connecting. */
export async function connect(
  config: Pick<ServerConfig, "webtransport_url" | "certificate_sha256" | "host" | "render_url">,
  choice: TransportChoice,
  signal: AbortSignal,
  now: Clock,
  backend: FrameBackend,
): Promise<Connected> {
  const host = config.host ?? null;
  const byFetch = (fallback: string | null): Connected => ({
    transport: decoded(new FetchTransport(now, hostUrl("render", config)), backend),
    fallback,
    host,
  });
  if (choice === "fetch") return byFetch(null);
  if (!globalThis.isSecureContext) return byFetch("this page is not a secure context");
  if (typeof globalThis.WebTransport !== "function") return byFetch("this browser has no WebTransport");
  if (config.webtransport_url === null) return byFetch("the server does not offer WebTransport");
  try {
    const transport = await backend.open(
      choice === "auto" ? "webtransport-streams" : choice,
      { url: config.webtransport_url, certificateSha256: config.certificate_sha256, timeout: SESSION_TIMEOUT },
      signal,
    );
    return { transport, fallback: null, host };
  } catch (error) {
    signal.throwIfAborted();
    return { ...byFetch(error instanceof Error ? error.message : String(error)), refused: true };
  }
}

/** The same transport, with decoded pictures. */
function decoded(transport: FrameTransport, backend: FrameBackend): FrameTransport {
  return {
    kind: transport.kind,
    maxInFlight: transport.maxInFlight,
    overtaking: transport.overtaking,
    lost: transport.lost,
    close: () => transport.close(),
    request: async (request, signal) => {
      const reply = await transport.request(request, signal);
      const picture = backend.decode(reply.image);
      picture.catch(() => undefined); // handled where it is shown
      return { ...reply, picture };
    },
  };
}
