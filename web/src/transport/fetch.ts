/** One `POST /render` per frame: works wherever a page works, with at most six connections on HTTP/1.1. */
import { deferred } from "../deferred";
import type { Problem, RenderRequest } from "../wire";
import { frameHeader } from "./http-fields";
import { type Clock, Receiver, readAll } from "./reception";
import { type FrameReply, type FrameTransport, RequestProblem } from "./transport";

export class FetchTransport implements FrameTransport {
  readonly kind = "fetch";
  /** Browsers open six connections to a server; one stays free for everything else. */
  readonly maxInFlight = 5;
  readonly overtaking = false;
  readonly lost: Promise<string>;
  readonly #lose: (reason: string) => void;
  readonly #closed = new AbortController();
  readonly #receiver: Receiver;

  constructor(now: Clock) {
    const { promise, resolve } = deferred<string>();
    this.lost = promise;
    this.#lose = resolve;
    this.#receiver = new Receiver(now);
  }

  async request(request: RenderRequest, signal: AbortSignal): Promise<FrameReply> {
    const either = AbortSignal.any([signal, this.#closed.signal]);
    const reception = this.#receiver.begin();
    try {
      const response = await fetch("render", {
        method: "POST",
        headers: { "Content-Type": "application/json" },
        body: JSON.stringify(request),
        cache: "no-store",
        signal: either,
      });
      if (!response.ok) throw new RequestProblem(await readProblem(response));
      const chunks = response.body === null ? [] : await readAll(response.body, reception, either);
      const header = frameHeader(response.status, response.headers);
      return { header, image: new Blob(chunks, { type: header.content_type }), arrival: reception.arrival };
    } catch (error) {
      if (!either.aborted && !(error instanceof RequestProblem)) this.#lose("The server does not answer.");
      throw error;
    }
  }

  close(): void {
    this.#closed.abort(new Error("the transport was closed"));
    this.#lose("The connection was closed.");
  }
}

/** The problem of a failed response; one is made up if the answer came from something else than our server. */
export async function readProblem(response: Response): Promise<Problem> {
  try {
    const problem = (await response.json()) as Problem;
    if (typeof problem?.detail === "string" && typeof problem.type === "string") return problem;
  } catch {
    // not JSON: a proxy's page, or nothing at all
  }
  return {
    type: "about:blank",
    title: response.statusText,
    status: response.status,
    detail: `The server answered with status ${response.status}.`,
  };
}
