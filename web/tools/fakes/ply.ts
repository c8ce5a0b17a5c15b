/** A compressed PLY for tests; its bytes count up, to show which of them were kept. */
export function compressedPly(gaussians: number, shDegree: 0 | 1 = 1): Uint8Array<ArrayBuffer> {
  const sh = Array.from({ length: 9 }, (_, i) => `f_rest_${i}`);
  return ply([
    { name: "chunk", count: Math.ceil(gaussians / 256), type: "float", properties: ["min_x", "max_x"] },
    { name: "vertex", count: gaussians, type: "uint", properties: ["a", "b", "c", "d"] },
    ...(shDegree > 0 ? [{ name: "sh", count: gaussians, type: "uchar", properties: sh } as const] : []),
  ]);
}

interface Element {
  readonly name: string;
  readonly count: number;
  readonly type: "float" | "uint" | "uchar";
  readonly properties: readonly string[];
}

function ply(elements: readonly Element[]): Uint8Array<ArrayBuffer> {
  const said = elements.flatMap(({ name, count, type, properties }) => [
    `element ${name} ${count}`,
    ...properties.map((property) => `property ${type} ${property}`),
  ]);
  const header = ["ply", "format binary_little_endian 1.0", "comment of a test", ...said, "end_header", ""].join("\n");
  const rows = elements.reduce(
    (sum, { count, type, properties }) => sum + count * properties.length * (type === "uchar" ? 1 : 4),
    0,
  );
  const body = Uint8Array.from({ length: rows }, (_, i) => i % 251);
  return new Uint8Array([...new TextEncoder().encode(header), ...body]);
}
