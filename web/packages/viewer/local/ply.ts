/**
 * Prefixes of a compressed PLY whose Gaussians are ordered by importance: each prefix is a valid file, and the best
 * picture of its size. It has ranges of 256 Gaussians each, then rows of 16 bytes, then the spherical harmonics, which
 * are optional.
 */

/** Shares of all Gaussians, for files that declare no parts. A part costs as much as its share, so all cost less than twice the last. */
const SHARES = [0.02, 0.05, 0.1, 0.25, 0.5] as const;

/** The next part to render from the received bytes; null to wait for more. */
export function nextStep(
  { gaussians, lines }: Pick<PlyHeader, "gaussians" | "lines">,
  there: Prefix,
  drawn: Prefix | null,
): Prefix | null {
  if (there.whole) return drawn?.whole ? null : there;
  const said = partsOf(lines);
  const parts = said.length > 0 ? said : SHARES.map((share) => Math.ceil(share * gaussians));
  const reached = [...parts, gaussians].findLast((count) => count <= there.gaussians) ?? 0;
  return reached > (drawn?.gaussians ?? 0) ? { gaussians: reached, whole: false } : null;
}

const PART = /^comment first (\d+) growth (\d+(?:\.\d+)?)$/;
/** Bounds of a range of scales, which are logarithms. */
const SCALE = /^(min|max)_scale_/;

export function isScale(type: string, name: string): boolean {
  return type === "float" && SCALE.test(name);
}

/** Numbers of Gaussians in the parts that the header declares, smallest first. */
function partsOf(header: readonly string[]): number[] {
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

export interface PlyHeader {
  readonly lines: readonly string[];
  /** Length in bytes, including the last line. */
  readonly bytes: number;
  readonly elements: readonly PlyElement[];
  /** Number of Gaussians in the whole file. */
  readonly gaussians: number;
}

interface PlyElement {
  readonly name: string;
  readonly count: number;
  /** Bytes of one row. */
  readonly stride: number;
  /** Byte offset of the scales in a row. */
  readonly scales: readonly number[];
}

/** The part of a file that can be rendered. */
export interface Prefix {
  readonly gaussians: number;
  /** All of the file. */
  readonly whole: boolean;
}

/** The file cannot be rendered here. */
export class BrokenPly extends Error {}

/** Gaussians that share a row of ranges. */
const RANGE = 256;
const LONGEST_HEADER = 65_536;
const END = "end_header\n";
const SIZES: Readonly<Record<string, number>> = {
  char: 1,
  uchar: 1,
  short: 2,
  ushort: 2,
  int: 4,
  uint: 4,
  float: 4,
  double: 8,
};

/** The header at the start of a file; null while it is incomplete. Throws BrokenPly. */
export function readHeader(file: Uint8Array): PlyHeader | null {
  const text = String.fromCharCode(...file.subarray(0, LONGEST_HEADER));
  const end = text.indexOf(END);
  if (!text.startsWith("ply\n".slice(0, text.length)) || (end < 0 && file.length >= LONGEST_HEADER)) {
    throw new BrokenPly("The downloaded scene is not a PLY file.");
  }
  if (end < 0) return null;
  const lines = text.slice(0, end).trimEnd().split("\n");
  const elements: { name: string; count: number; stride: number; scales: number[] }[] = [];
  for (const [word, first = "", second = ""] of lines.map((line) => line.split(" "))) {
    if (word === "element") elements.push({ name: first, count: Number(second), stride: 0, scales: [] });
    const element = elements.at(-1);
    if (word !== "property" || !element) continue;
    if (isScale(first, second)) element.scales.push(element.stride);
    element.stride += SIZES[first] ?? Number.NaN;
  }
  const vertex = elements.find(({ name }) => name === "vertex");
  const names = elements.map(({ name }) => name).join();
  const valid = elements.every(({ count, stride }) => Number.isSafeInteger(count) && stride > 0);
  if (!vertex || !valid || !["chunk,vertex", "chunk,vertex,sh"].includes(names)) {
    throw new BrokenPly("The downloaded scene is not a PLY file of Gaussians.");
  }
  return { lines, bytes: end + END.length, elements, gaussians: vertex.count };
}

/** The part that can be rendered from this many bytes of the file. */
export function arrived({ bytes, elements, gaussians }: PlyHeader, received: number): Prefix {
  const total = elements.reduce((sum, { count, stride }) => sum + count * stride, bytes);
  if (received >= total) return { gaussians, whole: true };
  let left = received - bytes;
  for (const { name, count, stride } of elements) {
    if (name === "vertex") return { gaussians: clamp(Math.floor(left / stride), count), whole: false };
    left -= count * stride;
  }
  return { gaussians: 0, whole: false };
}

/** The pieces of a file with only these Gaussians, enlarged while some are missing. */
export function prefixOf(
  header: PlyHeader,
  file: Uint8Array<ArrayBuffer>,
  { gaussians, whole }: Prefix,
): Uint8Array<ArrayBuffer>[] {
  const parts: Uint8Array<ArrayBuffer>[] = [];
  const counts: Record<string, number> = {};
  const growth = gaussians === header.gaussians ? 1 : growthOf(header.lines, gaussians);
  let at = header.bytes;
  for (const { name, count, stride, scales } of header.elements) {
    const kept = whole ? count : ({ vertex: gaussians, chunk: Math.ceil(gaussians / RANGE) }[name] ?? 0);
    counts[name] = kept;
    parts.push(grown(file.subarray(at, at + kept * stride), stride, scales, growth));
    at += count * stride;
  }
  return [new TextEncoder().encode(headerWith(header.lines, counts)), ...parts];
}

/** The same header with different counts; empty elements are left out. */
function headerWith(lines: readonly string[], counts: Readonly<Record<string, number>>): string {
  let kept = true;
  const said = lines.flatMap((line) => {
    const [word, name = ""] = line.split(" ");
    if (word !== "element") return kept ? [line] : [];
    kept = counts[name] !== 0;
    return kept ? [`element ${name} ${counts[name]}`] : [];
  });
  return `${said.join("\n")}\n${END}`;
}

function clamp(value: number, most: number): number {
  return Math.min(most, Math.max(0, value));
}
