/** Enlarges the first Gaussians of a scene, to close the gaps left by those still to be downloaded. */

const PART = /^comment first (\d+) growth (\d+(?:\.\d+)?)$/;
/** The ends of a range of scales, which are logarithms. */
const SCALE = /^(min|max)_scale_/;

export function isScale(type: string, name: string): boolean {
  return type === "float" && SCALE.test(name);
}

/** How many Gaussians the parts have that the header speaks of, the smallest first. */
export function partsOf(header: readonly string[]): number[] {
  return header.map((line) => Number(PART.exec(line)?.[1] ?? 0)).filter((count) => count > 0);
}

/** Best enlargement of this many first Gaussians: the header's value for the part of about that size. */
export function growthOf(header: readonly string[], gaussians: number): number {
  let [nearest, growth] = [Number.POSITIVE_INFINITY, 1];
  for (const [, count, factor] of header.flatMap((line) => [PART.exec(line) ?? []])) {
    const apart = Math.abs(Math.log(Number(count) / gaussians));
    if (apart < nearest) [nearest, growth] = [apart, Number(factor)];
  }
  return growth;
}

/** Rows with larger scales at the given byte offset of each; the same rows for a factor of 1. */
export function grown(
  rows: Uint8Array<ArrayBuffer>,
  stride: number,
  scales: readonly number[],
  growth: number,
): Uint8Array<ArrayBuffer> {
  if (scales.length === 0 || growth === 1) return rows;
  const copy = rows.slice();
  const view = new DataView(copy.buffer);
  const more = Math.log(growth);
  for (let row = 0; row + stride <= copy.length; row += stride) {
    for (const offset of scales) {
      view.setFloat32(row + offset, view.getFloat32(row + offset, true) + more, true);
    }
  }
  return copy;
}
