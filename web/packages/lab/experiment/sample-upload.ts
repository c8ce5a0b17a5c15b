/** Uploads a run's samples from this browser to the store; resumable (`docs/experiments.md`). */
import { ApiError } from "#client/http/problem";
import { describeSamples } from "../samples/sample-writer";
import { hold, readSampledRun, removeSampledRun, type SampledRun } from "../samples/sampled-runs";
import type { StoreApi } from "./store-api";

export type SampleStore = Pick<StoreApi, "add" | "uploadedSamples" | "addPicture" | "completeSamples">;

interface Upload {
  readonly key: string;
  /** Whether the store is known to have the samples' run. */
  readonly stored?: boolean;
  readonly store: SampleStore;
  /** Progress callback: stored and total bytes. */
  readonly progress: (sent: number, of: number) => void;
  readonly signal: AbortSignal;
}

const CLOSED = "The page was closed before the run's end; only its samples are left.";

/** Uploads samples and removes them from this browser. Rejects with an ApiError, or with the reason of `signal`. */
export function uploadSamples({ key, ...how }: Upload): Promise<void> {
  return holding(key, async () => {
    const run = await readSampledRun(key);
    if (run.samples.length > 0) await send(run, how);
    await removeSampledRun(key);
  });
}

/** Deletes samples. Rejects with an ApiError. */
export function deleteSamples(key: string): Promise<void> {
  return holding(key, () => removeSampledRun(key));
}

async function holding(key: string, work: () => Promise<void>): Promise<void> {
  const release = await hold(key);
  if (release === null) throw new ApiError("Another tab is using them.", false);
  try {
    await work();
  } finally {
    release();
  }
}

async function send(
  { key, about, pictures, bytes, samples }: SampledRun,
  { stored = false, store, progress, signal }: Omit<Upload, "key">,
): Promise<void> {
  if (about === null) throw new ApiError("Their run is unknown.", false);
  const { experiment, run } = about;
  if (!stored && !about.stored) await store.add(experiment, run, { problem: CLOSED });
  await describeSamples(key, { ...about, stored: true });
  const { complete, files } = await store.uploadedSamples(experiment, run);
  if (complete) return;
  const there = new Map(files.map(({ name, bytes }) => [name, bytes]));
  let sent = 0;
  for (const [name, picture] of pictures) {
    signal.throwIfAborted();
    progress(sent, bytes);
    if (there.get(name) !== picture.size) await store.addPicture(experiment, run, name, picture, signal);
    sent += picture.size;
  }
  progress(sent, bytes);
  await store.completeSamples(experiment, run, samples);
}
