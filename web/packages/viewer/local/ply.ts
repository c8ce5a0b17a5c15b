/**
 * Prefixes of a compressed PLY whose Gaussians are ordered by importance: each prefix is a valid file, and the best
 * picture of its size. It has ranges of 256 Gaussians each, then rows of 16 bytes, then the spherical harmonics, which
 * are optional.
 */
import { grown, growthOf, isScale } from "./growth";

export interface PlyHeader {
  readonly lines: readonly string[];
  /** With its last line. */
  readonly bytes: number;
  readonly elements: readonly PlyElement[];
  /** How many the whole file has. */
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

/** The parts of a file that has these Gaussians only, drawn larger while they are not all. */
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

/** The same header with other counts; an element that has none is left out. */
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
