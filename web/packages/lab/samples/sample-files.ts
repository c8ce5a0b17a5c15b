/**
 * Writes a run's samples into a folder of the private file system, in a worker, where files can be written without
 * copies (`createSyncAccessHandle`). The index only ever names samples with complete pictures.
 */
import type { Sample } from "#client/wire/store";
import { ABOUT, type About, enhancedName, INDEX, jpegName } from "./layout";

export class SampleFiles {
  readonly #folder: FileSystemDirectoryHandle;
  readonly #index: FileSystemSyncAccessHandle;
  /** Size of the index, in bytes. */
  #end = 0;

  private constructor(folder: FileSystemDirectoryHandle, index: FileSystemSyncAccessHandle) {
    this.#folder = folder;
    this.#index = index;
  }

  /** Starts in an empty folder; rejects if another tab is writing there. */
  static async create(folder: FileSystemDirectoryHandle, about: About | null): Promise<SampleFiles> {
    const file = await folder.getFileHandle(INDEX, { create: true });
    const index = await file.createSyncAccessHandle();
    try {
      index.truncate(0);
      if (about) await describe(folder, about);
    } catch (error) {
      index.close();
      throw error;
    }
    return new SampleFiles(folder, index);
  }

  /** Stores a sample and returns the bytes of its pictures. A sample that cannot be stored leaves nothing behind. */
  async keep(sample: Sample, jpeg: Blob, enhanced: Blob | null): Promise<number> {
    const pictures = [{ name: jpegName(sample.seq), picture: jpeg }];
    if (enhanced) pictures.push({ name: enhancedName(sample.seq, enhanced.type), picture: enhanced });
    try {
      for (const { name, picture } of pictures) await write(this.#folder, name, await picture.arrayBuffer());
      const line = new TextEncoder().encode(`${JSON.stringify(sample)}\n`);
      writeAll(this.#index, line, this.#end);
      this.#end += line.length;
    } catch (error) {
      this.#index.truncate(this.#end);
      for (const { name } of pictures) await this.#folder.removeEntry(name).catch(() => undefined);
      throw error;
    }
    return pictures.reduce((bytes, { picture }) => bytes + picture.size, 0);
  }

  close(): void {
    this.#index.close();
  }
}

/** Writes the run of a folder's samples. */
export function describe(folder: FileSystemDirectoryHandle, about: About): Promise<void> {
  return write(folder, ABOUT, new TextEncoder().encode(JSON.stringify(about)));
}

async function write(folder: FileSystemDirectoryHandle, name: string, content: BufferSource): Promise<void> {
  const file = await folder.getFileHandle(name, { create: true });
  const handle = await file.createSyncAccessHandle();
  try {
    handle.truncate(0);
    writeAll(handle, content, 0);
  } finally {
    handle.close();
  }
}

/** Writes all of it or fails: a full disk accepts a part without an error. */
function writeAll(handle: FileSystemSyncAccessHandle, content: BufferSource, at: number): void {
  if (handle.write(content, { at }) < content.byteLength) {
    throw new DOMException("The disk is full.", "QuotaExceededError");
  }
  handle.flush();
}
