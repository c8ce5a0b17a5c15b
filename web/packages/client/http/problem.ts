/** Requests to services, and their failures: problem details (RFC 9457), with one sentence to show. */
import "../async/abort-any";
import type { Problem } from "../wire/render";

/** Host names of the same machine, which a secure page may reach over plain HTTP. */
const LOOPBACK = /^(localhost|.*\.localhost|127(\.\d+){3}|\[::1\])$/;

/**
 * Whether browsers block a page at `page` from a service at `base`: a secure page may use plain HTTP only on the same
 * machine.
 */
export function mixedContent(base: string, page: string): boolean {
  const { protocol, hostname } = new URL(base);
  return new URL(page).protocol === "https:" && protocol === "http:" && !LOOPBACK.test(hostname);
}

export class ApiError extends Error {
  /** The server did not respond at all. */
  readonly unreachable: boolean;
  /** The problem's type, such as `tigas:unknown-run`. */
  readonly type: string | undefined;

  constructor(detail: string, unreachable: boolean, type?: string) {
    super(detail);
    this.name = "ApiError";
    this.unreachable = unreachable;
    this.type = type;
  }
}

/** Problem types of a server that asked another service for the page and got no answer. */
const PROXIED_SILENCE = ["tigas:service-away", "tigas:service-silent"];

export interface AskOptions extends Omit<RequestInit, "signal"> {
  readonly signal?: AbortSignal | undefined;
  /** In milliseconds; without it, the answer may take any time. */
  readonly timeout?: number;
}

/** Reads a service's answer. Rejects with an ApiError, or with the reason of `signal`; `silence` gives the sentence for no answer. */
export async function ask<T>(
  url: string,
  read: (answer: Response) => Promise<T>,
  silence: () => string,
  { signal, timeout, ...request }: AskOptions = {},
): Promise<T> {
  const late = timeout === undefined ? [] : [AbortSignal.timeout(timeout)];
  let answer: Response;
  try {
    const either = AbortSignal.any(signal ? [signal, ...late] : late);
    answer = await fetch(url, { cache: "no-store", ...request, signal: either });
    if (answer.ok) return await read(answer);
  } catch {
    signal?.throwIfAborted();
    throw new ApiError(silence(), true);
  }
  const { detail, type = "" } = await readProblem(answer);
  throw new ApiError(detail, PROXIED_SILENCE.includes(type), type);
}

/** The problem of a failed response. */
export async function readProblem(response: Response): Promise<Problem> {
  return problemOf(response.status, await response.text().catch(() => ""));
}

/** The problem in a response's body; a generic one if another server sent it. */
export function problemOf(status: number, body: string): Problem {
  try {
    const problem = JSON.parse(body) as Problem;
    if (typeof problem?.detail === "string" && typeof problem.type === "string") return problem;
  } catch {
    // not JSON: a proxy's page, or nothing at all
  }
  return { type: "about:blank", title: "", status, detail: `The server answered with status ${status}.` };
}
