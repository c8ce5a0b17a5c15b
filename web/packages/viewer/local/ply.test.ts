import { expect, test } from "vitest";
import { compressedPly } from "./fake-ply";
import { arrived, BrokenPly, type PlyHeader, prefixOf, readHeader } from "./ply";

const header = (file: Uint8Array) => readHeader(file) as PlyHeader;
const joined = (parts: readonly Uint8Array[]) => new Uint8Array(parts.flatMap((part) => [...part]));
const text = (file: Uint8Array) => new TextDecoder().decode(file);

test("a header is read as soon as all of it has come", () => {
  const file = compressedPly(10);
  const { bytes, gaussians, elements } = header(file);
  expect([gaussians, elements]).toEqual([
    10,
    [
      { name: "chunk", count: 1, stride: 8, scales: [] },
      { name: "vertex", count: 10, stride: 16, scales: [] },
      { name: "sh", count: 10, stride: 9, scales: [] },
    ],
  ]);
  expect(file.length).toBe(bytes + 8 + 10 * (16 + 9));
  expect(readHeader(file.subarray(0, bytes - 1))).toBeNull();
  expect(readHeader(file.subarray(0, 0))).toBeNull();
});

test.each([
  ["no PLY", "<!doctype html>"],
  ["another PLY", "ply\nformat binary_little_endian 1.0\nelement face 3\nproperty float x\nend_header\n"],
  ["a plain PLY", "ply\nelement vertex 3\nproperty float x\nend_header\n"],
  ["a broken count", "ply\nelement vertex many\nproperty float x\nend_header\n"],
  ["an unknown type", "ply\nelement vertex 3\nproperty list uchar int x\nend_header\n"],
  ["an endless header", `ply\n${"comment of no end\n".repeat(5000)}`],
])("%s is refused in a sentence", (_, content) => {
  const read = () => readHeader(new TextEncoder().encode(content));
  expect(read).toThrow(BrokenPly);
  expect(read).toThrow(/^The downloaded scene is not a PLY file.*\.$/);
});

test("a part of a file is a file of as many Gaussians as are whole in it", () => {
  const file = compressedPly(10);
  const head = header(file);
  const there = arrived(head, head.bytes + 8 + 3 * 16 + 15);
  expect(there).toEqual({ gaussians: 3, whole: false });
  const part = joined(prefixOf(head, file, there));
  const partHead = header(part);
  expect(partHead.gaussians).toBe(3);
  expect(part.subarray(partHead.bytes)).toEqual(file.subarray(head.bytes, head.bytes + 8 + 48));
  expect(text(part)).toContain("comment of a test");
});

test("nothing can be drawn before the first Gaussian, and all of a whole file is drawn as it is", () => {
  const file = compressedPly(10);
  const head = header(file);
  expect(arrived(head, head.bytes + 8 + 15).gaussians).toBe(0);
  const all = arrived(head, file.length);
  expect(all).toEqual({ gaussians: 10, whole: true });
  expect(joined(prefixOf(head, file, all))).toEqual(file);
});

test("a part has the ranges that its Gaussians need, and no spherical harmonics before all are there", () => {
  const file = compressedPly(600);
  const head = header(file);
  const ranges = 3 * 8;
  expect(arrived(head, head.bytes + ranges - 1).gaussians).toBe(0);
  const there = arrived(head, head.bytes + ranges + 300 * 16);
  expect(there).toEqual({ gaussians: 300, whole: false });
  const part = joined(prefixOf(head, file, there));
  expect(header(part).elements.map(({ name, count }) => [name, count])).toEqual([
    ["chunk", 2],
    ["vertex", 300],
  ]);
  expect(text(part)).not.toContain("f_rest_0");
  const rows = part.subarray(header(part).bytes);
  expect(rows).toEqual(
    new Uint8Array([
      ...file.subarray(head.bytes, head.bytes + 16),
      ...file.subarray(head.bytes + ranges, head.bytes + ranges + 300 * 16),
    ]),
  );
  expect(arrived(head, file.length - 1)).toEqual({ gaussians: 600, whole: false });
  expect(joined(prefixOf(head, file, arrived(head, file.length)))).toEqual(file);
});

test("a part is drawn larger, as the file says, and all of it as it is", () => {
  const lines = ["ply", "format binary_little_endian 1.0", "comment first 1 growth 2"];
  const chunk = ["element chunk 1", "property float min_x", "property float min_scale_x"];
  const said = [...lines, ...chunk, "element vertex 2", "property float a", "end_header", ""].join("\n");
  const rows = new Uint8Array(new Float32Array([5, -1, 6, 7]).buffer);
  const file = new Uint8Array([...new TextEncoder().encode(said), ...rows]);
  const head = header(file);
  const part = joined(prefixOf(head, file, { gaussians: 1, whole: false }));
  expect([...new Float32Array(part.slice(header(part).bytes).buffer)]).toEqual([5, Math.fround(-1 + Math.log(2)), 6]);
  expect(joined(prefixOf(head, file, { gaussians: 2, whole: true }))).toEqual(file);
});
