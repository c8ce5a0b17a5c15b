/** A private file system in memory, for tests: with a size limit and exclusive handles. */

export class FakeDisk {
  /** Free space in bytes. */
  room = Number.POSITIVE_INFINITY;
  readonly root = new FakeFolder(this);

  get folder(): FileSystemDirectoryHandle {
    return this.root as unknown as FileSystemDirectoryHandle;
  }
}

class FakeFolder {
  readonly kind = "directory";
  readonly children = new Map<string, FakeFolder | FakeFile>();
  readonly #disk: FakeDisk;

  constructor(disk: FakeDisk) {
    this.#disk = disk;
  }

  async getDirectoryHandle(name: string, { create = false } = {}): Promise<FakeFolder> {
    const found = this.children.get(name) ?? (create ? new FakeFolder(this.#disk) : undefined);
    if (!(found instanceof FakeFolder)) throw new DOMException(name, "NotFoundError");
    this.children.set(name, found);
    return found;
  }

  async getFileHandle(name: string, { create = false } = {}): Promise<FakeFile> {
    const found = this.children.get(name) ?? (create ? new FakeFile(name, this.#disk) : undefined);
    if (!(found instanceof FakeFile)) throw new DOMException(name, "NotFoundError");
    this.children.set(name, found);
    return found;
  }

  async removeEntry(name: string): Promise<void> {
    if (!this.children.delete(name)) throw new DOMException(name, "NotFoundError");
  }

  async *entries(): AsyncGenerator<[string, FakeFolder | FakeFile]> {
    yield* this.children;
  }

  /** Its files as text. */
  get texts(): Record<string, string> {
    const files = [...this.children].flatMap(([name, child]) => (child instanceof FakeFile ? [[name, child]] : []));
    return Object.fromEntries(files.map(([name, file]) => [name, new TextDecoder().decode((file as FakeFile).bytes)]));
  }
}

class FakeFile {
  readonly kind = "file";
  bytes = new Uint8Array(0);
  readonly #name: string;
  readonly #disk: FakeDisk;
  #open = false;

  constructor(name: string, disk: FakeDisk) {
    this.#name = name;
    this.#disk = disk;
  }

  async getFile(): Promise<File> {
    return new File([this.bytes], this.#name);
  }

  async createSyncAccessHandle(): Promise<FileSystemSyncAccessHandle> {
    if (this.#open) throw new DOMException("in use", "NoModificationAllowedError");
    this.#open = true;
    return {
      write: (content, { at } = { at: 0 }) => {
        const room = Math.max(0, Math.min(content.byteLength, this.#disk.room));
        const written = new Uint8Array(content as ArrayBuffer).subarray(0, room);
        this.#disk.room -= room;
        const grown = new Uint8Array(Math.max(this.bytes.length, at + room));
        grown.set(this.bytes);
        grown.set(written, at);
        this.bytes = grown;
        return room;
      },
      truncate: (size) => {
        this.bytes = this.bytes.slice(0, size);
      },
      flush: () => undefined,
      close: () => {
        this.#open = false;
      },
    };
  }
}
