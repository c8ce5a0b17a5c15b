/** Checks the text of the shaders; tests/web/test_scene_network.py compares their results with PyTorch in a browser. */
import { expect, test } from "vitest";
import { ONE, OTHER, safetensors, weights } from "#fakes/weights";
import { readNetworks } from "./networks";
import { fasterPrecision, shaders } from "./wgsl";

function networkOf(half: number, description: typeof ONE | typeof OTHER = ONE) {
  const { header, data } = weights([description], half);
  const [network] = readNetworks(safetensors(header, data));
  if (network === undefined) throw new Error("there is a network");
  return network;
}

test.each<[number, string, unknown]>([
  [0x3c00, "0x1.000p0", 1],
  [0xc200, "-0x1.800p1", -3],
  [0x2e66, "0x1.998p-4", 0.0999755859375],
  [0x7bff, "0x1.ffcp15", 65504],
  [0x0400, "0x1.000p-14", 2 ** -14],
  [0x03ff, "0.0", "less than any normal half"],
  [0x8000, "0.0", "minus nothing"],
])("the half %i is the literal %s: %s", (half, literal) => {
  const [layer] = shaders(networkOf(half), "f32");
  expect(layer?.code).toContain(`var sum0 = vec4<f32>(${Array(4).fill(literal).join(", ")});`);
});

test("numbers are halves where the device has them", () => {
  for (const { code } of shaders(networkOf(0x3c00), "f16")) expect(code).toMatch(/^enable f16;[\s\S]* vec4<f16>\(/);
  for (const { code } of shaders(networkOf(0x3c00), "f32")) expect(code).not.toContain("f16>(");
});

test("a tile fits into the workgroup memory that every device has", () => {
  for (const channels of [4, 8, 16, 24, 32]) {
    const network = networkOf(0x3c00, { ...OTHER, channels });
    for (const [precision, bytes] of [
      ["f16", 8],
      ["f32", 16],
    ] as const) {
      for (const { code } of shaders(network, precision)) {
        const numbers = Number(/tile: array<vec4<f\d\d>, (\d+)>/.exec(code)?.[1]);
        expect(numbers * bytes).toBeLessThanOrEqual(16_384);
      }
    }
  }
});

test.each<[string[], string | undefined, string]>([
  [["shader-f16"], "apple", "f16"],
  [["shader-f16"], undefined, "f16"],
  [["shader-f16"], "nvidia", "f32"],
  [[], "apple", "f32"],
])("a device with %j by %s computes in %s", (features, vendor, precision) => {
  const device = { features: new Set(features), ...(vendor !== undefined && { adapterInfo: { vendor } }) };
  expect(fasterPrecision(device)).toBe(precision);
});
