/**
 * Motion-to-photon latency: from the sample of an input to the first presented frame that was rendered from it, or from a
 * later one. Views are numbered as they change, so "later" is a larger number.
 */
export class MotionToPhoton {
  /** More samples than this without any frame, and the oldest are given up: nobody waits for them any more. */
  static readonly MAX_WAITING = 4096;
  #waiting: { readonly version: number; readonly at: number }[] = [];

  /** An input was sampled and made the view `version`. */
  sampled(version: number, at: number): void {
    this.#waiting.push({ version, at });
    if (this.#waiting.length > MotionToPhoton.MAX_WAITING) this.#waiting.shift();
  }

  /** The view `version` is on the screen; returns the latency of each input that it shows first, in milliseconds. */
  presented(version: number, at: number): number[] {
    const shown = this.#waiting.filter((sample) => sample.version <= version);
    this.#waiting = this.#waiting.filter((sample) => sample.version > version);
    return shown.map((sample) => at - sample.at);
  }

  /** For how long each input waits that no frame has shown yet, in milliseconds: its latency will be no less. */
  waiting(now: number): number[] {
    return this.#waiting.map(({ at }) => now - at);
  }

  /** Forget what waits: the frames will not come, for a reason that is not latency (a lost server, a hidden page). */
  reset(): void {
    this.#waiting = [];
  }
}
