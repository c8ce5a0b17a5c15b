/// <reference types="vitest/config" />
import { defineConfig } from "vite";
import { compress } from "./scripts/compress.mjs";
import { firstChunk } from "./scripts/first-chunk.mjs";

const SERVER = "http://localhost:8080";
/** Bytes of scripts that the first screen may need, compressed. */
const FIRST_SCREEN = 60_000;

export default defineConfig({
  base: "./",
  plugins: [firstChunk(FIRST_SCREEN), compress()],
  resolve: { tsconfigPaths: true },
  build: {
    outDir: "../services/render/tigas_render/static",
    emptyOutDir: true,
    modulePreload: { polyfill: false },
    chunkSizeWarningLimit: 3500, // Anime4K's networks, which are loaded on demand like dash.js
  },
  worker: { format: "es" },
  server: {
    proxy: Object.fromEntries(
      ["/config.json", "/healthz", "/render", "/scenes", "/uploads"].map((path) => [path, SERVER]),
    ),
  },
  test: {
    environment: "node",
    include: ["{app,packages,tools}/**/*.test.{ts,tsx}", "*.test.ts"],
    maxWorkers: "100%", // by default, vitest leaves a core idle
    pool: "threads", // threads start faster than processes; each file still has separate modules
    unstubGlobals: true, // before each test
    testTimeout: 60_000, // ms: simulations take seconds, and longer next to slow tests
  },
});
