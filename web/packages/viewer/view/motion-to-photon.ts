/**
 * Motion-to-photon latency: from the sample of an input to the first presented frame that was rendered from it, or from a
 * later one. Views are numbered as they change, so "later" is a larger number.
 */
export class MotionToPhoton {
  /** Number of samples kept without any frame; beyond it the oldest are dropped. */
  static readonly MAX_WAITING = 4096;
  #waiting: { readonly version: number; readonly at: number }[] = [];

  /** Records that an input was sampled and made the view `version`. */
  sampled(version: number, at: number): void {
    this.#waiting.push({ version, at });
    if (this.#waiting.length > MotionToPhoton.MAX_WAITING) this.#waiting.shift();
  }

  /** Records that the view `version` is on the screen; returns the latency of each input that it shows first, in milliseconds. */
  presented(version: number, at: number): number[] {
    const shown = this.#waiting.filter((sample) => sample.version <= version);
    this.#waiting = this.#waiting.filter((sample) => sample.version > version);
    return shown.map((sample) => at - sample.at);
  }

  /** Waiting time of each input not shown yet, in milliseconds: a lower bound of its latency. */
  waiting(now: number): number[] {
    return this.#waiting.map(({ at }) => now - at);
  }

  /** Drops waiting inputs that lost their frames for reasons other than latency (a lost server, a hidden page). */
  reset(): void {
    this.#waiting = [];
  }
}
