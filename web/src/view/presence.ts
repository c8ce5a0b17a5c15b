/** Visibility of the page. While it is hidden, browsers run no animation frames and nothing is measured. */

/**
 * Without an animation frame for this long (ms), the page counts as hidden or the machine as asleep, despite the
 * browser's report.
 */
const ASLEEP_AFTER = 2000;

export class Presence {
  readonly #document: Document;
  #hidden: boolean;
  #frameAt: number | undefined;

  constructor(page: Document = document) {
    this.#document = page;
    this.#hidden = page.hidden;
    page.addEventListener("visibilitychange", this.#changed);
  }

  dispose(): void {
    this.#document.removeEventListener("visibilitychange", this.#changed);
  }

  /** Once per animation frame: for how long the page was hidden since the last one, in milliseconds; usually 0. */
  gap(now: number): number {
    const since = now - (this.#frameAt ?? now);
    this.#frameAt = now;
    if (!this.#hidden && since <= ASLEEP_AFTER) return 0;
    this.#hidden = this.#document.hidden;
    return since;
  }

  readonly #changed = (): void => {
    this.#hidden ||= this.#document.hidden;
  };
}

/** Settles once the page is visible; rejects if aborted. */
export async function visible(signal: AbortSignal, page: Document = document): Promise<void> {
  signal.throwIfAborted();
  if (!page.hidden) return;
  await new Promise<void>((resolve, reject) => {
    const settled = new AbortController();
    const options = { signal: settled.signal };
    const settle = (how: () => void) => {
      settled.abort();
      how();
    };
    page.addEventListener("visibilitychange", () => page.hidden || settle(resolve), options);
    signal.addEventListener("abort", () => settle(() => reject(signal.reason)), options);
  });
}
