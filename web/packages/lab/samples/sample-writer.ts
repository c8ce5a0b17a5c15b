/** Writes a run's samples into the private file system, with a folder, lock and worker for the run. */
import { WorkerCalls } from "#client/async/worker-calls";
import type { Sample } from "#client/wire/store";
import type { About } from "./layout";
import { hold, samplesFolder } from "./sampled-runs";

export type SampleRequest =
  | { readonly kind: "begin"; readonly folder: FileSystemDirectoryHandle; readonly about: About | null }
  | { readonly kind: "describe"; readonly folder: FileSystemDirectoryHandle; readonly about: About }
  | { readonly kind: "keep"; readonly sample: Sample; readonly jpeg: Blob; readonly enhanced: ImageBitmap | null }
  | { readonly kind: "end" };

/** Reason why storing is impossible, in one sentence. */
export class SamplesRefused extends Error {}

/** Least free space for sampling, in bytes: a run takes tens of megabytes. */
const ROOM_AT_LEAST = 20_000_000;

export class SampleWriter {
  /** Name of the folder. */
  readonly key: string;
  readonly #calls: WorkerCalls<SampleRequest, number>;
  readonly #release: () => void;

  private constructor(key: string, calls: WorkerCalls<SampleRequest, number>, release: () => void) {
    this.key = key;
    this.#calls = calls;
    this.#release = release;
  }

  /** Rejects with SamplesRefused if the browser stores no files, or has no room for them. */
  static async open(about: About | null): Promise<SampleWriter> {
    const { key, all, release } = await refusing(async () => {
      const { quota = Number.POSITIVE_INFINITY, usage = 0 } = await navigator.storage.estimate();
      if (quota - usage < ROOM_AT_LEAST) throw new DOMException("", "QuotaExceededError");
      const key = crypto.randomUUID();
      return { key, all: await samplesFolder(), release: (await hold(key)) ?? (() => undefined) };
    });
    const calls = startWorker();
    try {
      await refusing(async () => {
        await calls.call({ kind: "begin", folder: await all.getDirectoryHandle(key, { create: true }), about });
      });
    } catch (error) {
      calls.dispose();
      await all.removeEntry(key, { recursive: true }).catch(() => undefined);
      release();
      throw error;
    }
    return new SampleWriter(key, calls, release);
  }

  /** Stores a sample and takes over the enhanced picture. Returns the bytes of both; rejects with SamplesRefused. */
  keep(sample: Sample, jpeg: Blob, enhanced: ImageBitmap | null): Promise<number> {
    const transfer = enhanced ? [enhanced] : [];
    return refusing(() => this.#calls.call({ kind: "keep", sample, jpeg, enhanced }, transfer));
  }

  /** Closes the folder, which other tabs may then use. */
  async close(): Promise<void> {
    await this.#calls.call({ kind: "end" }).catch(() => undefined);
    this.#calls.dispose();
    this.#release();
  }
}

/** Updates the description of a closed folder's run. */
export async function describeSamples(key: string, about: About): Promise<void> {
  const calls = startWorker();
  try {
    const folder = await (await samplesFolder()).getDirectoryHandle(key);
    await calls.call({ kind: "describe", folder, about });
  } finally {
    calls.dispose();
  }
}

function startWorker(): WorkerCalls<SampleRequest, number> {
  return new WorkerCalls(
    new Worker(new URL("./sample.worker.ts", import.meta.url), { type: "module", name: "samples" }),
  );
}

async function refusing<T>(work: () => Promise<T>): Promise<T> {
  try {
    return await work();
  } catch (error) {
    throw new SamplesRefused(refusal(error));
  }
}

function refusal(error: unknown): string {
  const { name, message } = error instanceof Error || error instanceof DOMException ? error : new Error(String(error));
  if (name === "QuotaExceededError") return "The browser’s storage is full.";
  if (name === "SecurityError" || name === "TypeError") {
    return "The browser stores no files for this page, as in a private window or without HTTPS.";
  }
  return `The browser cannot store files: ${message.replace(/\.?$/, ".")}`;
}
