/** Runs with samples in this browser that have not been uploaded yet. */
import type { Sample } from "#client/wire/store";
import { ABOUT, type About, enhancedName, FOLDER, INDEX, jpegName, readAbout } from "./layout";

export interface SampledRun {
  /** Name of its folder. */
  readonly key: string;
  /** Null if the folder has no valid description. */
  readonly about: About | null;
  readonly samples: readonly Sample[];
  /** The samples' pictures by name. */
  readonly pictures: ReadonlyMap<string, File>;
  /** Total bytes of the pictures. */
  readonly bytes: number;
  /** Whether a tab is sampling or uploading them. */
  readonly busy: boolean;
}

/** Rejects if the browser stores no files. */
export async function samplesFolder(): Promise<FileSystemDirectoryHandle> {
  const root = await navigator.storage.getDirectory();
  return root.getDirectoryHandle(FOLDER, { create: true });
}

/** All of them, oldest first; empty if the browser stores no files. */
export async function listSampledRuns(): Promise<readonly SampledRun[]> {
  let all: FileSystemDirectoryHandle;
  try {
    all = await samplesFolder();
  } catch {
    return [];
  }
  const found: SampledRun[] = [];
  for await (const [key, folder] of all.entries()) {
    if (folder.kind === "directory") found.push(await readFolder(key, folder));
  }
  const begun = ({ about }: SampledRun) => about?.started_unix_ms ?? 0;
  return found.sort((a, b) => begun(a) - begun(b));
}

/** Opens one of them; rejects if it was deleted. */
export async function readSampledRun(key: string): Promise<SampledRun> {
  return readFolder(key, await (await samplesFolder()).getDirectoryHandle(key));
}

export async function removeSampledRun(key: string): Promise<void> {
  await (await samplesFolder()).removeEntry(key, { recursive: true });
}

/** Locks a folder against all tabs, this one included; returns a function that unlocks it, or null if it is already locked. */
export function hold(key: string): Promise<(() => void) | null> {
  return new Promise((resolve, reject) => {
    const held = (lock: Lock | null) => {
      if (lock === null) return resolve(null);
      return new Promise<void>((release) => resolve(release));
    };
    navigator.locks.request(lockOf(key), { ifAvailable: true }, held).catch(reject);
  });
}

async function readFolder(key: string, folder: FileSystemDirectoryHandle): Promise<SampledRun> {
  const files = new Map<string, File>();
  for await (const [name, entry] of folder.entries()) {
    if (entry.kind === "file") files.set(name, await entry.getFile());
  }
  const text = async (name: string) => (await files.get(name)?.text()) ?? "";
  const samples = readIndex(await text(INDEX));
  const names = samples.flatMap((sample) => pictureNames(sample, files));
  const pictures = new Map(names.flatMap(([name, file]) => (file ? [[name, file]] : [])));
  const bytes = [...pictures.values()].reduce((sum, { size }) => sum + size, 0);
  const { held = [] } = await navigator.locks.query();
  const busy = held.some(({ name }) => name === lockOf(key));
  return { key, about: readAbout(await text(ABOUT)), samples, pictures, bytes, busy };
}

function pictureNames(sample: Sample, files: ReadonlyMap<string, File>): [string, File | undefined][] {
  const enhanced = ["image/webp", "image/png"].map((type) => enhancedName(sample.seq, type));
  const names = [jpegName(sample.seq), ...(sample.enhanced ? enhanced : [])];
  return names.map((name) => [name, files.get(name)]);
}

/** Reads the index, skipping a last line that a closed tab truncated. */
function readIndex(text: string): Sample[] {
  const lines = text.split("\n").slice(0, -1);
  return lines.map((line) => JSON.parse(line) as Sample);
}

function lockOf(key: string): string {
  return `tigas-samples-${key}`;
}
