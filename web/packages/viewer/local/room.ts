/** Whether a scene fits into this browser, before any of it is downloaded. */

export interface Weight {
  readonly gaussians: number;
  readonly shDegree: number;
  /** Size of the file, which is kept until it is complete. */
  readonly bytes: number;
}

/** Largest value reported by browsers, and the assumption where none is reported, in GB. */
const UNTOLD_MEMORY_GB = 4;
/** Usable share of the machine's memory; other pages and programs need the rest. */
const SHARE = 0.5;
const GB = 1e9;
/** Floats of a Gaussian except its spherical harmonics: centre, scales, rotation, opacity, colour. */
const FLOATS = 14;
/** Bytes on the graphics processor and for sorting: transform, colour and order, twice; centres in memory. */
const DRAWN = 76;
/** Bytes of its packed coefficients, at each degree. */
const DRAWN_SH = [0, 16, 32, 64] as const;

/** Estimated size of a download that has not been prepared yet: the server's own file may be packed differently. */
export function fileBytes(gaussians: number, shDegree: number): number {
  return gaussians * (16 + 3 * ((shDegree + 1) ** 2 - 1));
}

/** Bytes needed to draw a scene while its file is still in memory. */
export function memoryFor({ gaussians, shDegree, bytes }: Weight): number {
  const coefficients = 3 * ((shDegree + 1) ** 2 - 1);
  return bytes + gaussians * (4 * (FLOATS + coefficients) + DRAWN + (DRAWN_SH[shDegree] ?? 64));
}

/**
 * Reason for refusing to render the scene here, in one sentence; null if it fits. `memory`: reported by the browser, in
 * GB.
 */
export function roomProblem(weight: Weight, memory: number | undefined): string | null {
  const needed = memoryFor(weight);
  const room = SHARE * GB * (memory ?? UNTOLD_MEMORY_GB);
  if (needed <= room) return null;
  const gb = (value: number) => (value / GB).toFixed(1);
  return `This scene is too large for this browser: it needs ${gb(needed)} GB of memory, and about ${gb(room)} GB are available.`;
}
