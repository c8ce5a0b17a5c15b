/**
 * Layout of a run's samples in the browser's private files (OPFS), until they are uploaded:
 *
 *     samples/KEY/run.json             the run they belong to (`About`)
 *     samples/KEY/samples.ndjson       one Sample per line, written after its pictures
 *     samples/KEY/000123.jpg           and further files as in a run's folder of the store (`docs/experiments.md`)
 */
import * as v from "valibot";

export const FOLDER = "samples";
export const ABOUT = "run.json";
export const INDEX = "samples.ndjson";

const AboutSchema = v.object({
  /** The store's names of experiment and run. */
  experiment: v.string(),
  run: v.string(),
  /** Whether the store has this attempt of the run. */
  stored: v.boolean(),
  title: v.string(),
  started_unix_ms: v.number(),
});
/** The run that samples belong to. */
export type About = Readonly<v.InferOutput<typeof AboutSchema>>;

/** Null if invalid. */
export function readAbout(text: string): About | null {
  try {
    return v.parse(AboutSchema, JSON.parse(text));
  } catch {
    return null;
  }
}

export function jpegName(seq: number): string {
  return `${number(seq)}.jpg`;
}

/** By the picture's media type. */
export function enhancedName(seq: number, type: string): string {
  return `${number(seq)}.enhanced.${type === "image/png" ? "png" : "webp"}`;
}

function number(seq: number): string {
  return String(seq).padStart(6, "0");
}
