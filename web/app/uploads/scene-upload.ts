/** Upload of one scene file: sent in parts (tus), so that a broken connection costs nothing, then checked. */
import { type ReadonlySignal, signal } from "@preact/signals";
import type { DetailedError, Upload } from "tus-js-client";
import { retry } from "#client/async/retry";
import { ApiError, problemOf } from "#client/http/problem";
import type { AddedScene } from "#client/wire/render";
import { addUploaded } from "#viewer/state/api";

export type UploadState =
  | { readonly kind: "waiting" }
  | { readonly kind: "sending"; readonly sent: number }
  /** The upload is complete, and the server checks it. */
  | { readonly kind: "checking" }
  /** `again`: another try may succeed. */
  | { readonly kind: "failed"; readonly message: string; readonly again: boolean };

/** Delays of retries without progress, in milliseconds. */
const RETRIES = [0, 500, 1000, 2000, 4000, 8000, 15_000, 30_000];
/** Transient statuses: no answer, a part that another connection sent first, and a server that is busy or starting. */
const PASSING = [0, 409, 502, 503, 504];

let made = 0;

export class SceneUpload {
  readonly file: File;
  /** Identifier within this page. */
  readonly number = made++;
  readonly #state = signal<UploadState>({ kind: "waiting" });
  readonly #cancelled = new AbortController();

  constructor(file: File) {
    this.file = file;
  }

  get state(): ReadonlySignal<UploadState> {
    return this.#state;
  }

  get cancelled(): boolean {
    return this.#cancelled.signal.aborted;
  }

  /** Cancels the upload and makes the server drop its part. */
  cancel(): void {
    this.#cancelled.abort();
  }

  /** Refuses a file that will not be sent. */
  refuse(message: string): void {
    this.#state.value = { kind: "failed", message, again: false };
  }

  wait(): void {
    this.#state.value = { kind: "waiting" };
  }

  /** Resolves with the new scene; null if it failed, as its state explains, or was cancelled. */
  async run(): Promise<AddedScene | null> {
    const { signal } = this.#cancelled;
    if (signal.aborted) return null;
    try {
      const upload = await this.#send();
      if (!upload?.url) return null;
      const { url } = upload;
      this.#state.value = { kind: "checking" };
      const added = await retry(() => addUploaded(url, signal), {
        retries: RETRIES.length,
        signal,
        shouldRetry: (error) => error instanceof ApiError && error.unreachable,
      });
      await forget(upload);
      return added;
    } catch (error) {
      if (!signal.aborted) this.#state.value = { kind: "failed", message: sentence(error), again: true };
      return null;
    }
  }

  /** Resolves once the upload is complete; null if it was cancelled. */
  async #send(): Promise<Upload | null> {
    const { Upload } = await import("tus-js-client");
    const { signal } = this.#cancelled;
    if (signal.aborted) return null;
    return await new Promise((resolve, reject) => {
      const upload = new Upload(this.file, {
        endpoint: new URL("uploads", document.baseURI).href,
        metadata: { filename: this.file.name },
        retryDelays: RETRIES,
        onShouldRetry: (error) => PASSING.includes(error.originalResponse?.getStatus() ?? 0),
        onProgress: (sent) => {
          this.#state.value = { kind: "sending", sent };
        },
        onSuccess: () => resolve(upload),
        onError: reject,
      });
      signal.addEventListener("abort", () => {
        // the server drops abandoned uploads anyway
        upload.abort(true).catch(() => undefined);
        resolve(null);
      });
      upload.findPreviousUploads().then(([previous]) => {
        if (signal.aborted) return;
        if (previous) upload.resumeFromPreviousUpload(previous);
        upload.start();
      }, reject);
    });
  }
}

/** Forgets an upload that has become a scene, so that sending it again is a new upload. Until then, the server may still have it. */
async function forget(upload: Upload): Promise<void> {
  for (const { urlStorageKey } of await upload.findPreviousUploads()) {
    await upload.options.urlStorage?.removeUpload(urlStorageKey);
  }
}

function sentence(error: unknown): string {
  if (error instanceof ApiError) return error.message;
  const answer = (error as Partial<DetailedError>).originalResponse;
  return answer ? problemOf(answer.getStatus(), answer.getBody()).detail : "The server is not responding.";
}
