import type { Plugin } from "vite";

export function firstChunk(budget: number): Plugin;
