import { expect, test } from "vitest";
import { compressedPly } from "#fakes/ply";
import {
  arrived,
  BrokenPly,
  grown,
  growthOf,
  isScale,
  nextStep,
  type PlyHeader,
  type Prefix,
  prefixOf,
  readHeader,
} from "./ply";

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

const HEADER = ["ply", "comment first 256 growth 1.536", "comment first 1024 growth 1.2", "element vertex 9000"];

test.each([
  [200, 1.536],
  [260, 1.536],
  [1000, 1.2],
  [5000, 1.2],
])("%i Gaussians are drawn %f times larger, as the header says of about as many", (gaussians, growth) => {
  expect(growthOf(HEADER, gaussians)).toBe(growth);
});

test("without a word about it, Gaussians are drawn as they are", () => {
  expect(growthOf(["ply", "comment first light", "comment first 256 growth"], 256)).toBe(1);
});

test("scales are the ends of ranges", () => {
  expect(["min_scale_x", "max_scale_z"].every((name) => isScale("float", name))).toBe(true);
  expect([isScale("uint", "scale_0"), isScale("float", "packed_scale"), isScale("float", "x")]).not.toContain(true);
});

test("only scales change, in a copy", () => {
  const rows = new Uint8Array(new Float32Array([1, -3, 2, -4]).buffer); // x and a scale of two Gaussians
  const before = rows.slice();
  expect([...new Float32Array(grown(rows, 8, [4], Math.E).buffer)]).toEqual([1, -2, 2, -3]);
  expect(rows).toEqual(before);
  expect(grown(rows, 8, [], 2)).toBe(rows);
  expect(grown(rows, 8, [4], 1)).toBe(rows);
});

const OF_1000 = { gaussians: 1000, lines: [] };
const OF_600 = { gaussians: 600, lines: [] };

test("a scene is built anew at 2, 5, 10, 25, 50 and 100 % of its Gaussians, and no oftener", () => {
  const drawn: (Prefix | null)[] = [null];
  for (let there = 0; there <= 1000; there++) {
    const step = nextStep(OF_1000, { gaussians: there, whole: there === 1000 }, drawn.at(-1) ?? null);
    if (step) drawn.push(step);
  }
  expect(drawn.slice(1).map((step) => step?.gaussians)).toEqual([20, 50, 100, 250, 500, 1000]);
  expect(drawn.at(-1)?.whole).toBe(true);
});

test("what came at once is drawn at once: steps in between are left out", () => {
  expect(nextStep(OF_1000, { gaussians: 612, whole: false }, { gaussians: 20, whole: false })?.gaussians).toBe(500);
  expect(nextStep(OF_1000, { gaussians: 1000, whole: true }, null)).toEqual({ gaussians: 1000, whole: true });
});

test("all Gaussians without their spherical harmonics are not the last step", () => {
  const bare = nextStep(OF_600, { gaussians: 600, whole: false }, { gaussians: 300, whole: false });
  expect(bare).toEqual({ gaussians: 600, whole: false });
  expect(nextStep(OF_600, { gaussians: 600, whole: false }, bare)).toBeNull();
  expect(nextStep(OF_600, { gaussians: 600, whole: true }, bare)).toEqual({ gaussians: 600, whole: true });
});

test("a file that says which parts of it are pictures is drawn at these", () => {
  const header = { gaussians: 1000, lines: ["comment first 256 growth 2.0", "comment first 512 growth 1.5"] };
  expect(nextStep(header, { gaussians: 255, whole: false }, null)).toBeNull();
  expect(nextStep(header, { gaussians: 511, whole: false }, null)?.gaussians).toBe(256);
  expect(nextStep(header, { gaussians: 999, whole: false }, { gaussians: 256, whole: false })?.gaussians).toBe(512);
});
