/** Options shared by the simulator's programs. */
import { readFileSync } from "node:fs";
import type { parseArgs } from "node:util";
import { WAYS } from "#client/abr/controller";
import { PAPER_LADDER } from "#client/abr/ladder";
import type { Rung } from "#client/wire/render";
import type { PaperOptions } from "../endpoints";

/** For `parseArgs`. */
export const SHARED = {
  controller: { type: "string", multiple: true },
  render: { type: "string" },
  "render-best": { type: "string" },
  scale: { type: "string" },
  batch: { type: "string" },
  ladder: { type: "string" },
  way: { type: "string", default: "predicted" },
  seed: { type: "string", default: "1" },
  json: { type: "string" },
  help: { type: "boolean", default: false },
} as const;

type Values = ReturnType<typeof parseArgs<{ options: typeof SHARED }>>["values"];

/** Parses the shared options. Throws an Error with one sentence for the user. */
export function shared(values: Values) {
  const way = WAYS.find((one) => one === values.way);
  if (way === undefined) throw new Error(`--way is one of ${WAYS.join(", ")}, not "${values.way}".`);
  const ladder: readonly Rung[] =
    values.ladder === undefined ? PAPER_LADDER : JSON.parse(readFileSync(values.ladder, "utf8")).rungs;
  const names = { render: "render", renderBest: "render-best", scale: "scale", batch: "batch" } as const;
  const server: PaperOptions = Object.fromEntries(
    Object.entries(names).flatMap(([name, option]) => {
      const text = values[option];
      return text === undefined ? [] : [[name, number(`--${option}`, text)]];
    }),
  );
  return { way, ladder, server, seed: number("--seed", values.seed) };
}

/** Parses a number of at least 0. Throws an Error with one sentence for the user. */
export function number(option: string, text: string): number {
  const value = Number(text);
  if (text.trim() === "" || !Number.isFinite(value) || value < 0) {
    throw new Error(`${option} needs a number of at least 0, not “${text}”.`);
  }
  return value;
}
