/** Whether a scene fits into this browser, before any of it is downloaded. */
import type { SceneDownload } from "../wire/render";

export interface Weight {
  readonly gaussians: number;
  readonly shDegree: number;
  /** Of the file; it is kept until all of it has come. */
  readonly bytes: number;
}

/** What browsers tell at most, and what a machine has that does not tell, in GB. */
const UNTOLD_MEMORY_GB = 4;
/** Of the machine's memory, which other pages and programs need, too. */
const SHARE = 0.5;
const GB = 1e9;
/** Floats of a Gaussian but for its spherical harmonics: centre, scales, rotation, opacity, colour. */
const FLOATS = 14;
/** On the graphics processor and for sorting: transform, colour and order, twice; centres in memory. */
const DRAWN = 76;
/** Of its packed coefficients, at each degree. */
const DRAWN_SH = [0, 16, 32, 64] as const;

/** About what a file of the scene has that was not made yet: the server's own may be packed in another way. */
export function fileBytes(form: SceneDownload["form"], gaussians: number, shDegree: number): number {
  const coefficients = 3 * ((shDegree + 1) ** 2 - 1);
  return gaussians * (form === "ply" ? 4 * (FLOATS + coefficients) : 16 + coefficients);
}

/** Bytes that it takes to draw a scene while its file is still there. */
export function memoryFor({ gaussians, shDegree, bytes }: Weight): number {
  const coefficients = 3 * ((shDegree + 1) ** 2 - 1);
  return bytes + gaussians * (4 * (FLOATS + coefficients) + DRAWN + (DRAWN_SH[shDegree] ?? 64));
}

/** Why the scene cannot be drawn here, in one sentence; null if it can. `memory`: what the browser tells of its machine, in GB. */
export function roomProblem(weight: Weight, memory: number | undefined): string | null {
  const needed = memoryFor(weight);
  const room = SHARE * GB * (memory ?? UNTOLD_MEMORY_GB);
  if (needed <= room) return null;
  const gb = (value: number) => (value / GB).toFixed(1);
  return `This scene is too large for this browser: it would take ${gb(needed)} GB of memory, and there is room for ${gb(room)} GB.`;
}
