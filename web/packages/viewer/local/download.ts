/** Fetches a file into memory, resuming where it was cut off. */

import { retry } from "#client/async/retry";
import { ApiError, readProblem } from "#client/http/problem";

export interface DownloadOptions {
  /** Its URL, resolved for each request. */
  readonly url: () => string;
  readonly signal: AbortSignal;
  /** Progress: the file at its full length, and the number of received bytes. */
  readonly onBytes: (file: Uint8Array<ArrayBuffer>, received: number) => void;
  /** Called when the download is interrupted; it resumes automatically. */
  readonly onCut: (message: string) => void;
}

/** Transient statuses. */
const BUSY = [408, 429, 502, 503, 504];
/** A download without a byte for this many milliseconds counts as interrupted. */
const PATIENCE = 20_000;

/** The server ended its answer early, or was unreachable; the download is retried. */
class CutOff extends Error {}

/**
 * Resolves with the whole file. Throws ApiError with a sentence if it is unavailable, and the reason of `signal` if
 * aborted.
 */
export async function download(options: DownloadOptions): Promise<Uint8Array<ArrayBuffer>> {
  const { signal, onCut } = options;
  const file = new PartialFile(options);
  await retry(() => file.resume(), {
    minTimeout: 300,
    maxTimeout: 4000,
    factor: 1.6,
    signal,
    shouldRetry: (error) => error instanceof CutOff,
    onFailedAttempt: (error) => {
      if (error instanceof CutOff) onCut(error.message);
    },
  });
  return file.bytes;
}

class PartialFile {
  bytes = new Uint8Array(0);
  readonly #options: DownloadOptions;
  #received = 0;
  /** Version of the received bytes. */
  #etag: string | null = null;

  constructor(options: DownloadOptions) {
    this.#options = options;
  }

  /** Requests the missing bytes. */
  async resume(): Promise<void> {
    const { signal } = this.#options;
    const attempt = new AbortController();
    const either = AbortSignal.any([signal, attempt.signal]);
    let timer = setTimeout(() => attempt.abort(), PATIENCE);
    try {
      const response = await this.#ask(either);
      this.#begin(response);
      const reader = response.body?.getReader();
      while (reader && this.#received < this.bytes.length) {
        clearTimeout(timer);
        timer = setTimeout(() => attempt.abort(), PATIENCE);
        const { value } = await reader.read().catch(() => ({ value: undefined }));
        if (value === undefined) break;
        this.#take(value);
      }
    } finally {
      clearTimeout(timer);
      attempt.abort(); // the remaining bytes are useless
    }
    signal.throwIfAborted();
    if (this.#received < this.bytes.length) throw new CutOff("The download was interrupted.");
  }

  async #ask(signal: AbortSignal): Promise<Response> {
    const rest = { range: `bytes=${this.#received}-`, ...(this.#etag && { "if-range": this.#etag }) };
    const headers = this.#received > 0 ? rest : undefined;
    let response: Response;
    try {
      response = await fetch(this.#options.url(), { cache: "no-store", signal, ...(headers && { headers }) });
    } catch (error) {
      if (this.#options.signal.aborted) throw error;
      throw new CutOff("The server is not responding.");
    }
    if (response.ok) return response;
    const { detail } = await readProblem(response);
    throw BUSY.includes(response.status) ? new CutOff(detail) : new ApiError(detail, false);
  }

  /** Resumes an interrupted download, or starts over: the first time, and if the file has changed. */
  #begin(response: Response): void {
    const [, from, total] = /^bytes (\d+)-\d+\/(\d+)$/.exec(response.headers.get("content-range") ?? "") ?? [];
    const resumed = response.status === 206;
    const length = Number(resumed ? total : response.headers.get("content-length"));
    if (!Number.isSafeInteger(length) || length <= 0 || (resumed && Number(from) !== this.#received)) {
      throw new ApiError("The server did not report the size of the scene.", false);
    }
    this.#etag = response.headers.get("etag");
    if (resumed && length === this.bytes.length) return;
    this.#received = 0;
    try {
      this.bytes = new Uint8Array(length);
    } catch {
      throw new ApiError("This browser does not have enough memory for this scene.", false);
    }
  }

  #take(part: Uint8Array): void {
    if (this.#received + part.length > this.bytes.length) {
      throw new ApiError("The server sent more data than it announced.", false);
    }
    this.bytes.set(part, this.#received);
    this.#received += part.length;
    this.#options.onBytes(this.bytes, this.#received);
  }
}
