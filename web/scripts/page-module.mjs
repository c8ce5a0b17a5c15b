// Runs the page's own TypeScript in a script.
import { fileURLToPath } from "node:url";
import { runnerImport } from "vite";

/** A TypeScript module, by its path in `web` without an ending. */
export function load(name) {
  return run(fileURLToPath(new URL(`../${name}.ts`, import.meta.url)));
}

/** A TypeScript module, by its absolute path. */
export async function run(path) {
  const config = { configFile: false, logLevel: "error", resolve: { tsconfigPaths: true } };
  return (await runnerImport(path, config)).module;
}
