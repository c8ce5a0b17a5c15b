/** Worker-only parts of the private file system: TypeScript's DOM library lacks them. */
interface FileSystemSyncAccessHandle {
  write(bytes: BufferSource, options?: { readonly at: number }): number;
  truncate(size: number): void;
  flush(): void;
  close(): void;
}
interface FileSystemFileHandle {
  createSyncAccessHandle(): Promise<FileSystemSyncAccessHandle>;
}
