/** A part of the build: each text of it once more in brotli and gzip, for a server that sends what was compressed ahead. */
import { readdirSync, readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { brotliCompressSync, constants, gzipSync } from "node:zlib";

const TEXTS = /\.(css|html|js|svg)$/;
/** A twentieth of the time of the best quality, for a few per cent more bytes. */
const QUALITY = 9;

/** A plugin of Vite. */
export function compress() {
  let folder;
  return {
    name: "compress",
    apply: "build",
    configResolved(config) {
      folder = config.build.outDir;
    },
    closeBundle() {
      for (const name of readdirSync(folder, { recursive: true }).filter((one) => TEXTS.test(one))) {
        const path = join(folder, name);
        const text = readFileSync(path);
        writeFileSync(`${path}.gz`, gzipSync(text, { level: 9 }));
        writeFileSync(
          `${path}.br`,
          brotliCompressSync(text, { params: { [constants.BROTLI_PARAM_QUALITY]: QUALITY } }),
        );
      }
    },
  };
}
