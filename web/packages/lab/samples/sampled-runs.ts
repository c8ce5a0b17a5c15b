/** Runs with samples in this browser that no store has yet. */
import type { Sample } from "#client/wire/store";
import { ABOUT, type About, enhancedName, FOLDER, INDEX, jpegName, readAbout } from "./layout";

export interface SampledRun {
  /** Of its folder. */
  readonly key: string;
  /** Null where the folder does not say. */
  readonly about: About | null;
  readonly samples: readonly Sample[];
  /** The samples' pictures by name. */
  readonly pictures: ReadonlyMap<string, File>;
  /** Of these. */
  readonly bytes: number;
  /** A tab samples or uploads them at the moment. */
  readonly busy: boolean;
}

/** Rejects where the browser keeps no files. */
export async function samplesFolder(): Promise<FileSystemDirectoryHandle> {
  const root = await navigator.storage.getDirectory();
  return root.getDirectoryHandle(FOLDER, { create: true });
}

/** All of them, the oldest first; none where the browser keeps no files. */
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

/** Keeps all other tabs, and this one, from a folder until the function that this returns is called; null if another has it. */
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

/** Skips a line truncated by a closed tab. */
function readIndex(text: string): Sample[] {
  const lines = text.split("\n").slice(0, -1);
  return lines.map((line) => JSON.parse(line) as Sample);
}

function lockOf(key: string): string {
  return `tigas-samples-${key}`;
}
