/** Any bytes in place of a scene's weights become shaders or are refused in a sentence. */

import fc from "fast-check";
import { expect, test } from "vitest";
import { EFFORT } from "#fakes/effort";
import { ONE, OTHER, safetensors, weights } from "#fakes/weights";
import { EnhancementError } from "../model/enhancer";
import { readNetworks } from "./networks";
import { shaders } from "./wgsl";

const SOUND = weights([ONE, OTHER]);
const TEXT = JSON.stringify(SOUND.header);
const PIECES = [
  ...['"', "{", "}", "[", "]", ",", "\\", "\0", "\n", "-1", "1e999", "0.5", "null", '"__proto__":{},', '"shape":[],'],
  ...["F32", "rung2", "conv0", "bias", "99999999999999999999", "[1,0]", "x".repeat(70_000), "٣"],
];

const edit = fc.record({
  at: fc.nat(TEXT.length),
  length: fc.constantFrom(0, 0, 1, 2, 8, 200),
  piece: fc.oneof(fc.constantFrom(...PIECES), fc.string({ maxLength: 8 })),
});
/** Valid files with an edited header, or edited bytes. */
const files = fc.oneof(
  fc
    .array(edit, { maxLength: 3 })
    .map((edits) =>
      edits.reduce((text, { at, length, piece }) => text.slice(0, at) + piece + text.slice(at + length), TEXT),
    )
    .map((text) => safetensors(text, SOUND.data)),
  fc.array(fc.tuple(fc.nat({ max: 40_000 }), fc.nat({ max: 255 })), { maxLength: 6 }).map((bytes) => {
    const file = new Uint8Array(safetensors(SOUND.header, SOUND.data));
    for (const [at, byte] of bytes) file[at % file.length] = byte;
    return file.buffer;
  }),
  fc.nat({ max: 20_000 }).map((length) => safetensors(SOUND.header, SOUND.data).slice(0, length)),
  fc.uint8Array({ maxLength: 200 }).map((bytes) => Uint8Array.from(bytes).buffer),
);

test("any bytes are networks or one sentence", () => {
  fc.assert(
    fc.property(files, (file) => {
      try {
        for (const network of readNetworks(file)) {
          expect(
            shaders(network, "f16")
              .map(({ code }) => code)
              .join(),
          ).not.toMatch(/undefined|NaN|Infinity|p16/);
        }
      } catch (error) {
        expect(error).toBeInstanceOf(EnhancementError);
        expect((error as Error).message).toMatch(/^[^\n]{1,400}\.$/);
      }
    }),
    EFFORT,
  );
});
