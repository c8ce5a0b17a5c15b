/** Keeps to the rate at which a busy server may be asked: between requests, animation frames are left out. */

export class RequestPace {
  /** Between requests, in milliseconds; 0 if the server does not say. */
  #interval = 0;
  /** From when on the next request may go out, on the page's clock. */
  #next = Number.NEGATIVE_INFINITY;

  /** Interval announced by the newest answer; null: one request per display frame. */
  told(requestsPerS: number | null): void {
    this.#interval = requestsPerS === null ? 0 : 1000 / requestsPerS;
  }

  allows(now: number): boolean {
    return this.#interval === 0 || now >= this.#next;
  }

  /** A request that has to wait for an animation frame does not make the next ones late. */
  sent(now: number): void {
    this.#next = Math.max(this.#next, now - this.#interval) + this.#interval;
  }
}
