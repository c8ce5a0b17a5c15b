/**
 * A Vite plugin that puts everything the first screen needs into one chunk, and fails the build if the chunk exceeds its
 * budget. Everything else is loaded on demand, by dynamic imports.
 */
import { brotliCompressSync } from "node:zlib";

/** @param {number} budget Bytes of the first chunk, compressed by Brotli. */
export function firstChunk(budget) {
  /** @type {Set<string>} */
  const needed = new Set();
  return {
    name: "first-chunk",
    config: () => ({
      build: {
        rolldownOptions: {
          output: {
            codeSplitting: { groups: [{ name: "index", test: (/** @type {string} */ id) => needed.has(id) }] },
          },
        },
      },
    }),
    /** Modules that the entry reaches without a dynamic import. */
    buildEnd() {
      needed.clear();
      const waiting = [...this.getModuleIds()].filter((id) => this.getModuleInfo(id)?.isEntry);
      for (const id of waiting) {
        if (needed.has(id)) continue;
        needed.add(id);
        waiting.push(...(this.getModuleInfo(id)?.importedIds ?? []));
      }
    },
    generateBundle(_, bundle) {
      const chunks = Object.values(bundle).filter(({ type }) => type === "chunk");
      const first = new Set(chunks.filter(({ isEntry }) => isEntry));
      for (const chunk of first) {
        for (const file of chunk.imports) if (bundle[file]) first.add(bundle[file]);
      }
      const size = [...first].reduce((sum, { code }) => sum + brotliCompressSync(code).length, 0);
      const told = `The first screen needs ${(size / 1000).toFixed(1)} kB of scripts`;
      if (size > budget) this.error(`${told}, more than ${budget / 1000} kB: load more of it on demand.`);
      this.info(`${told} in ${first.size} ${first.size === 1 ? "file" : "files"}.`);
    },
  };
}
