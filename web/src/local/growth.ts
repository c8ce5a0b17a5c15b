/** The first Gaussians of a scene, drawn larger than they are: so they close the gaps which those leave that have yet to come. */

const PART = /^comment first (\d+) growth (\d+(?:\.\d+)?)$/;
/** A scale, or the ends of a range of scales; all are logarithms. */
const SCALE = /^(min_|max_)?scale_/;

export function isScale(type: string, name: string): boolean {
  return type === "float" && SCALE.test(name);
}

/** How many Gaussians the parts have that the header speaks of, the smallest first. */
export function partsOf(header: readonly string[]): number[] {
  return header.map((line) => Number(PART.exec(line)?.[1] ?? 0)).filter((count) => count > 0);
}

/** How many times larger so many of the first Gaussians are best drawn: what the header says of the part that has about as many. */
export function growthOf(header: readonly string[], gaussians: number): number {
  let [nearest, growth] = [Number.POSITIVE_INFINITY, 1];
  for (const [, count, factor] of header.flatMap((line) => [PART.exec(line) ?? []])) {
    const apart = Math.abs(Math.log(Number(count) / gaussians));
    if (apart < nearest) [nearest, growth] = [apart, Number(factor)];
  }
  return growth;
}

/** Rows with larger scales, which lie so many bytes into each; the same rows where there are none. */
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
