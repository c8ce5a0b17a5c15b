/** What only workers have of the private file system: TypeScript's DOM library leaves it out. */
interface FileSystemSyncAccessHandle {
  write(bytes: BufferSource, options?: { readonly at: number }): number;
  truncate(size: number): void;
  flush(): void;
  close(): void;
}
interface FileSystemFileHandle {
  createSyncAccessHandle(): Promise<FileSystemSyncAccessHandle>;
}
