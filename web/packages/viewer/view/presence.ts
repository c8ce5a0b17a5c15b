/**
 * Whether the viewer is visible. Nothing is drawn or measured while the page is hidden, or the viewer scrolled out of
 * it; a viewer that stays hidden gives up its connection, its streams and its decoders.
 */
import { type ReadonlySignal, signal } from "@preact/signals";
import { deferred } from "#client/async/deferred";

/**
 * Without an animation frame for this long (ms), the page counts as hidden or the machine as asleep, despite the
 * browser's report.
 */
const ASLEEP_AFTER = 2000;
/** A page hidden for longer than this is left, in milliseconds: after a quick look at another page, the viewer continues at once. */
export const LEFT_AFTER = 10_000;

export class Presence {
  readonly #visible = signal(true);
  readonly #left = signal(false);
  readonly #offline = signal(false);
  readonly #page: Document;
  readonly #listening = new AbortController();
  #away = false;
  #leaving: ReturnType<typeof setTimeout> | undefined;
  /** Whether it was hidden at any time since the last animation frame. */
  #hidden: boolean;
  #frameAt: number | undefined;

  constructor(page: Document = document, window: EventTarget = globalThis) {
    this.#page = page;
    this.#hidden = page.hidden;
    const { signal: stop } = this.#listening;
    const on = (target: EventTarget, names: readonly string[], listener: () => void) => {
      for (const name of names) target.addEventListener(name, listener, { signal: stop });
    };
    on(page, ["visibilitychange", "resume"], () => this.#look());
    on(window, ["pageshow"], () => this.#look());
    on(page, ["freeze"], () => this.#leave());
    on(window, ["pagehide"], () => this.#leave());
    on(window, ["online", "offline"], () => {
      this.#offline.value = !navigator.onLine;
    });
    this.#offline.value = globalThis.navigator?.onLine === false;
    this.#look();
  }

  get visible(): ReadonlySignal<boolean> {
    return this.#visible;
  }

  /** Whether the page has been hidden for some time, is frozen, or is kept for the back button. */
  get left(): ReadonlySignal<boolean> {
    return this.#left;
  }

  /** Whether the browser has no network; a server on this machine can still answer. */
  get offline(): ReadonlySignal<boolean> {
    return this.#offline;
  }

  /** Whether the viewer is scrolled out of the window, or not displayed: it then counts as hidden. */
  set away(away: boolean) {
    this.#away = away;
    this.#look();
  }

  dispose(): void {
    clearTimeout(this.#leaving);
    this.#listening.abort();
  }

  /** Called once per animation frame: how long the page was hidden since the last one, in milliseconds; usually 0. */
  gap(now: number): number {
    const since = now - (this.#frameAt ?? now);
    this.#frameAt = now;
    if (!this.#hidden && since <= ASLEEP_AFTER) return 0;
    this.#hidden = this.#isHidden;
    return since;
  }

  /** Calls `task` at this interval (ms) while the page is visible; returns a function that stops it. */
  every(interval: number, task: () => void): () => void {
    const timer = setInterval(() => {
      if (this.#visible.peek()) task();
    }, interval);
    return () => clearInterval(timer);
  }

  /** Settles once the page is visible; rejects if aborted. */
  readonly untilVisible = async (stop: AbortSignal): Promise<void> => {
    stop.throwIfAborted();
    if (this.#visible.peek()) return;
    const shown = deferred<undefined>();
    const abort = () => shown.reject(stop.reason);
    stop.addEventListener("abort", abort);
    const forget = this.#visible.subscribe((visible) => visible && shown.resolve(undefined));
    await shown.promise.finally(() => {
      forget();
      stop.removeEventListener("abort", abort);
    });
  };

  get #isHidden(): boolean {
    return this.#page.hidden || this.#away;
  }

  #look(): void {
    const hidden = this.#isHidden;
    this.#visible.value = !hidden;
    this.#hidden ||= hidden;
    clearTimeout(this.#leaving);
    if (hidden) this.#leaving = setTimeout(() => this.#leave(), LEFT_AFTER);
    else this.#left.value = false;
  }

  #leave(): void {
    clearTimeout(this.#leaving);
    this.#left.value = true;
  }
}
