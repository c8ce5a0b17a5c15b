/** A SourceBuffer that accepts bytes at any time and removes played media. */

/** Played media older than this many seconds is removed; some more is kept to make removals rare. */
const KEPT = 5;
const FORGET_EVERY = 5;

export interface MediaBufferOptions {
  readonly source: SourceBuffer;
  /** Aborted when the source leaves the player: from then on any access to it throws. */
  readonly signal: AbortSignal;
  /** Playback position, in seconds. */
  readonly position: () => number;
  readonly onAppended: () => void;
  readonly onFailed: (reason: string) => void;
}

export class MediaBuffer {
  readonly #options: MediaBufferOptions;
  /** Operations queued until the source is ready; it handles one at a time. */
  #waiting: Uint8Array<ArrayBuffer>[] = [];
  /** Whether the source is full and played media is being removed. */
  #full = false;
  /** Whether the source may hold an incomplete box. */
  #interrupted = false;

  constructor(options: MediaBufferOptions) {
    this.#options = options;
    const { source, signal, onAppended, onFailed } = options;
    const onUpdated = () => {
      onAppended();
      this.#next();
    };
    source.addEventListener("updateend", onUpdated, { signal });
    const onError = () => onFailed("The player stopped: the stream cannot be read.");
    source.addEventListener("error", onError, { signal });
  }

  append(bytes: Uint8Array<ArrayBuffer>): void {
    this.#waiting.push(bytes);
    this.#next();
  }

  /** Continues with another segment before the current one is complete: drops queued bytes. */
  interrupt(): void {
    this.#waiting = [];
    this.#interrupted = true;
  }

  /** End of the buffered media in seconds; null if empty or closed. */
  get end(): number | null {
    if (this.#options.signal.aborted) return null;
    const { buffered } = this.#options.source;
    return buffered.length === 0 ? null : buffered.end(buffered.length - 1);
  }

  #next(): void {
    const { source, signal, position } = this.#options;
    if (signal.aborted || source.updating || this.#waiting.length === 0) return;
    if (this.#interrupted) source.abort(); // drops an incomplete box
    this.#interrupted = false;
    const start = source.buffered.length === 0 ? 0 : source.buffered.start(0);
    const played = position() - KEPT;
    if (played - start > FORGET_EVERY) {
      source.remove(0, played);
      return;
    }
    const [bytes, ...rest] = this.#waiting;
    if (bytes === undefined) return;
    try {
      source.appendBuffer(bytes);
      this.#waiting = rest;
      this.#full = false;
    } catch (error) {
      this.#refused(error);
    }
  }

  /** Makes room in a full source, once. */
  #refused(error: unknown): void {
    const { source, position, onFailed } = this.#options;
    const full = error instanceof DOMException && error.name === "QuotaExceededError";
    if (full && !this.#full && position() > 0) {
      this.#full = true;
      source.remove(0, position());
    } else onFailed("The player stopped: the browser cannot buffer any more of the stream.");
  }
}
