/** Opens a WebTransport session to the render service. */
import { deferred } from "../async/deferred";

export interface SessionOptions {
  readonly url: string;
  /** Base64 of the certificate's SHA-256, or null if the certificate comes from an authority that the browser knows. */
  readonly certificateSha256: string | null;
  /** How long to wait for the session, in milliseconds. */
  readonly timeout: number;
}

type Open = (url: string, options: WebTransportOptions) => WebTransport;

/** Opens a session. Rejects with one sentence on a timeout, with the signal's reason if aborted. */
export async function openSession(
  { url, certificateSha256, timeout }: SessionOptions,
  signal: AbortSignal,
  open: Open = (target, options) => new WebTransport(target, options),
): Promise<WebTransport> {
  signal.throwIfAborted();
  const session = open(url, {
    ...(certificateSha256 !== null && {
      serverCertificateHashes: [{ algorithm: "sha-256", value: fromBase64(certificateSha256) }],
    }),
  });
  // Both reject when the session fails; only the race below is to report it.
  session.closed.catch(() => undefined);
  const either = AbortSignal.any([signal, AbortSignal.timeout(timeout)]);
  const { promise: aborted, reject } = deferred<never>();
  const abort = () => reject(either.reason);
  either.addEventListener("abort", abort, { once: true });
  try {
    await Promise.race([session.ready, aborted]);
    return session;
  } catch (error) {
    session.ready.catch(() => undefined);
    closeQuietly(session);
    signal.throwIfAborted();
    throw new Error(either.aborted ? "QUIC did not respond in time" : "QUIC could not connect", { cause: error });
  } finally {
    either.removeEventListener("abort", abort);
  }
}

/** Settles once the session has ended, with a sentence. */
export async function sessionEnd(session: WebTransport): Promise<string> {
  return session.closed.then(
    () => "The server closed the connection.",
    () => "The connection to the server was lost.",
  );
}

export function closeQuietly(session: WebTransport): void {
  try {
    session.close();
  } catch {
    // it was closed already
  }
}

function fromBase64(text: string): Uint8Array<ArrayBuffer> {
  return Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
}
