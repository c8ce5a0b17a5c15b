/** One `POST /render` per frame: works wherever a page works, with at most six connections on HTTP/1.1. */

import { deferred } from "../async/deferred";
import { readProblem } from "../http/problem";
import type { RenderRequest } from "../wire/render";
import { frameHeader } from "./http-fields";
import { type Clock, Receiver, readAll } from "./reception";
import { type FrameReply, type FrameTransport, RequestProblem } from "./transport";

/** Identifier of this visit, to separate viewers behind the same gateway. */
const VIEWER = crypto.getRandomValues(new Uint32Array(4)).join("-");

export class FetchTransport implements FrameTransport {
  readonly kind = "fetch";
  /** Browsers open six connections to a server; one stays free for everything else. */
  readonly maxInFlight = 5;
  readonly overtaking = false;
  readonly lost: Promise<string>;
  readonly #lose: (reason: string) => void;
  readonly #closed = new AbortController();
  readonly #receiver: Receiver;

  readonly #url: string;

  /** `url`: frame endpoint, relative to the page's address. */
  constructor(now: Clock, url = "render") {
    const { promise, resolve } = deferred<string>();
    this.lost = promise;
    this.#lose = resolve;
    this.#receiver = new Receiver(now);
    this.#url = url;
  }

  async request(request: RenderRequest, signal: AbortSignal): Promise<FrameReply> {
    const either = AbortSignal.any([signal, this.#closed.signal]);
    const reception = this.#receiver.begin();
    try {
      const response = await fetch(this.#url, {
        method: "POST",
        headers: { "Content-Type": "application/json", "Tigas-Viewer": VIEWER },
        body: JSON.stringify(request),
        cache: "no-store",
        signal: either,
      });
      if (!response.ok) {
        const problem = await readProblem(response);
        if (problem.type === "tigas:full") this.#lose(problem.detail);
        throw new RequestProblem(problem);
      }
      const chunks = response.body === null ? [] : await readAll(response.body, reception, either);
      const header = frameHeader(response.status, response.headers);
      return { header, image: new Blob(chunks, { type: header.content_type }), arrival: reception.arrival };
    } catch (error) {
      if (!either.aborted && !(error instanceof RequestProblem)) this.#lose("The server is not responding.");
      throw error;
    }
  }

  close(): void {
    this.#closed.abort(new Error("the transport was closed"));
    this.#lose("The connection was closed.");
  }
}
