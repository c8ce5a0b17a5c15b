/** Uploads a run's samples from this browser to the store, with resumption: see `docs/experiments.md`. */
import { ApiError } from "../http/problem";
import { describeSamples } from "../samples/sample-writer";
import { hold, readSampledRun, removeSampledRun, type SampledRun } from "../samples/sampled-runs";
import { readPlan } from "./plan";
import type { StoreApi } from "./store-api";

/** A run as the store names it. */
export interface RunPlace {
  readonly experiment: string;
  readonly run: string;
}

export type SampleStore = Pick<
  StoreApi,
  "create" | "addInterrupted" | "uploadedSamples" | "addPicture" | "completeSamples"
>;

interface Upload {
  readonly key: string;
  /** Where the run is; null: where it was said to be before, or a new place if it was never ended. */
  readonly place: RunPlace | null;
  readonly store: SampleStore;
  /** Progress callback: stored and total bytes. */
  readonly progress: (sent: number, of: number) => void;
  readonly signal: AbortSignal;
}

/** Removes them from this browser afterwards. Rejects with an ApiError, or with the reason of `signal`. */
export function uploadSamples({ key, place, ...how }: Upload): Promise<void> {
  return holding(key, async () => {
    const run = await readSampledRun(key);
    if (run.samples.length > 0) await send(run, place ?? (await placeFor(run, how.store)), how);
    await removeSampledRun(key);
  });
}

/** Gives samples up. Rejects with an ApiError. */
export function deleteSamples(key: string): Promise<void> {
  return holding(key, () => removeSampledRun(key));
}

async function holding(key: string, work: () => Promise<void>): Promise<void> {
  const release = await hold(key);
  if (release === null) throw new ApiError("Another tab has them in use.", false);
  try {
    await work();
  } finally {
    release();
  }
}

async function send(
  run: SampledRun,
  place: RunPlace,
  { store, progress, signal }: Pick<Upload, "store" | "progress" | "signal">,
): Promise<void> {
  if (run.about) await describeSamples(run.key, { ...run.about, ...place });
  const { complete, files } = await store.uploadedSamples(place.experiment, place.run);
  if (complete) return;
  const there = new Map(files.map(({ name, bytes }) => [name, bytes]));
  let sent = 0;
  for (const [name, picture] of run.pictures) {
    signal.throwIfAborted();
    progress(sent, run.bytes);
    if (there.get(name) !== picture.size) await store.addPicture(place.experiment, place.run, name, picture, signal);
    sent += picture.size;
  }
  progress(sent, run.bytes);
  await store.completeSamples(place.experiment, place.run, run.samples);
}

/** The run's place in the store, created if missing. */
async function placeFor({ key, about }: SampledRun, store: SampleStore): Promise<RunPlace> {
  const plan = readPlan(about?.plan);
  if (about === null || plan === null) throw new ApiError("It is not known of which run they are.", false);
  const experiment = about.experiment ?? (await store.create(plan));
  await describeSamples(key, { ...about, experiment });
  if (about.run !== null) return { experiment, run: about.run };
  const { configuration, started_unix_ms } = about;
  const { folder } = await store.addInterrupted(experiment, { configuration, started_unix_ms });
  return { experiment, run: folder };
}
