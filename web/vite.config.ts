import { defineConfig } from "vitest/config";

const SERVER = "http://localhost:8080";

export default defineConfig({
  base: "./",
  build: {
    outDir: "../services/render/tigas_render/static",
    emptyOutDir: true,
    modulePreload: { polyfill: false },
    chunkSizeWarningLimit: 3500, // Anime4K's networks, which are loaded on demand as dash.js is
  },
  worker: { format: "es" },
  server: {
    proxy: Object.fromEntries(["/config.json", "/healthz", "/render", "/scenes"].map((path) => [path, SERVER])),
  },
  test: { environment: "node", include: ["src/**/*.test.{ts,tsx}"] },
});
