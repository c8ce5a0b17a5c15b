import { expect, test } from "vitest";
import type { Rung } from "#client/wire/render";
import { type Header, LADDER, ONE, OTHER, safetensors, weights } from "#fakes/weights";
import { EnhancementError } from "../model/enhancer";
import { type Network, networksFor, readNetworks } from "./networks";

const SOUND = weights([ONE, OTHER]);

/** A valid file's header with changes. */
function changed(change: (header: Header) => void): ArrayBuffer {
  const header = structuredClone(SOUND.header);
  change(header);
  return safetensors(header, SOUND.data);
}

function described(change: object): ArrayBuffer {
  return changed((header) => {
    header.__metadata__.networks = JSON.stringify([{ ...ONE, ...change }, OTHER]);
  });
}

test("a file has a network for each of its rungs", () => {
  const [one, other] = readNetworks(safetensors(SOUND.header, SOUND.data));
  expect(one).toMatchObject({ rung: 1, width: 32, height: 18, quality: 35, scale: 2 });
  expect(one?.layers.map(({ inputs, outputs }) => [inputs, outputs])).toEqual([
    [3, 4],
    [4, 12],
  ]);
  expect(other?.layers.map(({ weights, bias }) => [weights.length, bias.length])).toEqual([
    [8 * 3 * 9, 8],
    [8 * 8 * 9, 8],
    [3 * 8 * 9, 3],
  ]);
});

test("values keep their tensor and their place", () => {
  const { header, data } = weights([ONE]);
  for (let i = 0; i < data.length; i++) data[i] = i;
  const [network] = readNetworks(safetensors(header, data));
  expect(network?.layers[0]?.bias).toEqual(Uint16Array.of(108, 109, 110, 111));
  expect(network?.layers[1]?.weights.at(-1)).toBe(108 + 4 + 432 - 1);
});

/** A tensor after ONE's tensors. */
const WITH_MORE = (() => {
  const { header, data } = weights([ONE]);
  const more = { dtype: "F16", shape: [], data_offsets: [data.byteLength, data.byteLength + 2] };
  return safetensors({ ...header, more }, new Uint16Array(data.length + 1));
})();

test.each<[string, ArrayBuffer, RegExp]>([
  ["nothing", new ArrayBuffer(0), /truncated/],
  ["a web page", new TextEncoder().encode("<!doctype html><title>Not found</title>").buffer, /header is larger/],
  ["a header of many megabytes", Uint8Array.of(0, 0, 0, 1, 0, 0, 0, 0, 123).buffer, /header is larger than 64 KiB/],
  ["a header that ends nowhere", Uint8Array.of(99, 0, 0, 0, 0, 0, 0, 0, 123).buffer, /truncated/],
  ["a header that is not JSON", safetensors("{", SOUND.data), /not a safetensors file/],
  ["a truncated file", safetensors(SOUND.header, SOUND.data).slice(0, -2), /truncated/],
  ["a file with something behind", safetensors(SOUND.header, new Uint16Array(5000)), /data after the last tensor/],
  ["more than 1 MB", new ArrayBuffer(1_000_001), /larger than 1 MB/],
  ["infinite weights", safetensors(SOUND.header, weights([ONE, OTHER], 0xfc00).data), /not a finite number/],
  ["NaN", safetensors(SOUND.header, SOUND.data.with(700, 0x7e01)), /rung2\.conv0\.weight.* not a finite number/],
  ["no metadata", changed((header) => Reflect.deleteProperty(header, "__metadata__")), /does not know: ""/],
  ["metadata that are numbers", changed((header) => (header.__metadata__.version = 2)), /metadata/],
  ["another architecture", changed((header) => (header.__metadata__.architecture = "gan\n")), /not know: "gan\\n"/],
  ["no networks", changed((header) => (header.__metadata__.networks = "[]")), /list of networks/],
  ["networks that are not JSON", changed((header) => (header.__metadata__.networks = "[")), /list of networks/],
  ["a scale of 3", described({ scale: 3 }), /list of networks/],
  ["channels that are not fours", described({ channels: 6 }), /list of networks/],
  ["a thousand layers", described({ layers: 1000 }), /list of networks/],
  ["one rung twice", described({ rung: 2 }), /rung twice/],
  ["a layer that is missing", described({ layers: 3 }), /shape \[12,4,3,3\], not \[4,4,3,3\]/],
  ["a network without its tensors", described({ rung: 3 }), /lack the tensor rung3\.conv0\.weight/],
  ["another shape", described({ channels: 8 }), /rung1\.conv0\.weight is of shape \[4,3,3,3\], not \[8,3,3,3\]/],
  ["a tensor too many", WITH_MORE, /unused tensor: "more"/],
  [
    "whole precision",
    changed((header) => (header["rung1.conv0.bias"] = { dtype: "F32", shape: [4], data_offsets: [216, 224] })),
    /"rung1\.conv0\.bias" is not declared/,
  ],
  [
    "overlapping tensors",
    changed((header) => (header["rung1.conv0.bias"] = { dtype: "F16", shape: [4], data_offsets: [0, 8] })),
    /offsets that its shape implies/,
  ],
])("%s is refused in a sentence", (_, file, reason) => {
  expect(() => readNetworks(file)).toThrow(EnhancementError);
  expect(() => readNetworks(file)).toThrow(reason);
  expect(() => readNetworks(file)).toThrow(/^[^\n]{1,400}\.$/);
});

test("a rung has the network that was trained for the nearest size, and for the nearer quality of two, if one is near", () => {
  const at = (height: number, quality: number) => ({ ...LADDER[0], width: (height * 16) / 9, height, quality }) as Rung;
  const [one, other] = readNetworks(safetensors(SOUND.header, SOUND.data)) as [Network, Network];
  const networks = [one, other, { ...one, quality: 80 }, { ...one, height: 24 }];
  const chosen = networksFor(
    networks,
    [90, 30.1, 24, 18, 18, 14.4, 14.3, 9, 7].map((height, i) => at(height, i === 4 ? 70 : 40)),
  );
  expect(chosen).toEqual([undefined, undefined, networks[3], one, networks[2], one, undefined, other, undefined]);
});

test("networks that are near no rung are refused in a sentence", () => {
  const networks = readNetworks(safetensors(SOUND.header, SOUND.data));
  expect(() => networksFor(networks, LADDER)).not.toThrow();
  expect(() => networksFor(networks, LADDER.slice(0, 1))).toThrow(
    new EnhancementError("its weights were trained for other frame sizes than this ladder's."),
  );
});
