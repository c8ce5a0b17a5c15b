/** A SourceBuffer that takes bytes at any time, and forgets what was played. */

/** What was played this long ago is forgotten, in seconds; somewhat more is kept, so that it is seldom done. */
const KEPT = 5;
const FORGET_EVERY = 5;

export interface MediaBufferOptions {
  readonly source: SourceBuffer;
  /** Aborted when the source leaves the player: from then on even looking at it throws. */
  readonly signal: AbortSignal;
  /** Where playback is, in seconds. */
  readonly position: () => number;
  /** There is something new to play. */
  readonly onAppended: () => void;
  readonly onFailed: (reason: string) => void;
}

export class MediaBuffer {
  readonly #options: MediaBufferOptions;
  /** What waits until the source takes more; it works on one thing at a time. */
  #waiting: Uint8Array<ArrayBuffer>[] = [];
  /** The source is full: what was played is being removed. */
  #full = false;
  /** The source may hold half a box. */
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

  /** The stream goes on with another segment, in the middle of one: drops what waits. */
  interrupt(): void {
    this.#waiting = [];
    this.#interrupted = true;
  }

  /** The end of what has come, in seconds; null if nothing has, or the source has left. */
  get end(): number | null {
    if (this.#options.signal.aborted) return null;
    const { buffered } = this.#options.source;
    return buffered.length === 0 ? null : buffered.end(buffered.length - 1);
  }

  #next(): void {
    const { source, signal, position } = this.#options;
    if (signal.aborted || source.updating || this.#waiting.length === 0) return;
    if (this.#interrupted) source.abort(); // forgets half a box
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

  /** There is no room: makes some, once. */
  #refused(error: unknown): void {
    const { source, position, onFailed } = this.#options;
    const full = error instanceof DOMException && error.name === "QuotaExceededError";
    if (full && !this.#full && position() > 0) {
      this.#full = true;
      source.remove(0, position());
    } else onFailed("The player stopped: the browser takes no more of the stream.");
  }
}
