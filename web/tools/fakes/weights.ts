/** Valid and invalid files of weights, for tests. */
import type { Rung } from "#client/wire/render";

export type Header = Record<string, unknown> & {
  __metadata__: Record<string, unknown>;
};

export const LADDER: Rung[] = [
  { name: "High", width: 64, height: 36, quality: 90, expected_kb: 1 },
  { name: "Low", width: 32, height: 18, quality: 35, expected_kb: 1 },
  { name: "Lower", width: 16, height: 9, quality: 10, expected_kb: 1 },
];

export const ONE = { rung: 1, width: 32, height: 18, quality: 35, scale: 2, layers: 2, channels: 4, gain_db: 1.2 };
export const OTHER = { rung: 2, width: 16, height: 9, quality: 10, scale: 1, layers: 3, channels: 8, gain_db: null };

/** Makes a file of these networks, with every weight `half`. */
export function weights(
  networks: readonly (typeof ONE | typeof OTHER)[],
  half = 0x3800,
): { header: Header; data: Uint16Array } {
  const header: Header = {
    __metadata__: {
      architecture: "tigas-sr-1",
      scene_sha256: "general",
      networks: JSON.stringify(networks),
      created: "2026-11-22T12:00:00Z",
      version: "0.2.0",
    },
  };
  let end = 0;
  for (const { rung, scale, layers, channels } of networks) {
    for (let i = 0; i < layers; i++) {
      const inputs = i === 0 ? 3 : channels;
      const outputs = i === layers - 1 ? 3 * scale ** 2 : channels;
      for (const [name, shape] of [
        ["weight", [outputs, inputs, 3, 3]],
        ["bias", [outputs]],
      ] as const) {
        const start = end;
        end += 2 * shape.reduce((product, extent) => product * extent, 1);
        header[`rung${rung}.conv${i}.${name}`] = { dtype: "F16", shape, data_offsets: [start, end] };
      }
    }
  }
  return { header, data: new Uint16Array(end / 2).fill(half) };
}

export function safetensors(header: unknown, data: Uint16Array | Uint8Array): ArrayBuffer {
  const text = new TextEncoder().encode(typeof header === "string" ? header : JSON.stringify(header));
  const file = new Uint8Array(8 + text.length + data.byteLength);
  new DataView(file.buffer).setBigUint64(0, BigInt(text.length), true);
  file.set(text, 8);
  file.set(new Uint8Array(data.buffer, data.byteOffset, data.byteLength), 8 + text.length);
  return file.buffer;
}
