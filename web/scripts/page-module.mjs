// Runs the page's own TypeScript in a script.
import { fileURLToPath } from "node:url";
import { runnerImport } from "vite";

/** A module of `src`, by its path without an ending. */
export async function load(name) {
  const path = fileURLToPath(new URL(`../src/${name}.ts`, import.meta.url));
  return (await runnerImport(path, { configFile: false, logLevel: "error" })).module;
}
