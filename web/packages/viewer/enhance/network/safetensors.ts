/**
 * Reads safetensors, strictly: a length, a JSON header, then the tensors in sequence
 * (github.com/huggingface/safetensors). Weights may come from an untrusted server, so every error is reported in one
 * sentence. Pure.
 */
import * as v from "valibot";
import { EnhancementError } from "../model/enhancer";

export interface Tensor {
  readonly shape: readonly number[];
  /** Half-precision floats (IEEE 754 binary16) in storage format, row-major; all are finite. */
  readonly halves: Uint16Array;
}

export interface Safetensors {
  readonly metadata: Readonly<Record<string, string>>;
  readonly tensors: ReadonlyMap<string, Tensor>;
}

/** Largest file in bytes; a network of tens of thousands of weights takes a tenth of it. */
export const MAX_BYTES = 1_000_000;
const MAX_HEADER_BYTES = 65_536;
/** All exponent bits: infinite or not a number. */
const NOT_FINITE = 0x7c00;

const natural = v.pipe(v.number(), v.safeInteger(), v.minValue(0));
const Metadata = v.record(v.string(), v.string());
const Description = v.strictObject({
  dtype: v.literal("F16"),
  shape: v.array(natural),
  data_offsets: v.tuple([natural, natural]),
});

/** Reads a file. Throws EnhancementError. */
export function readSafetensors(file: ArrayBuffer): Safetensors {
  if (file.byteLength > MAX_BYTES) throw new EnhancementError("its weights are larger than 1 MB.");
  const [header, data] = parts(file);
  const { __metadata__: metadata = {}, ...descriptions } = header;
  if (!v.is(Metadata, metadata)) throw new EnhancementError("its weights' metadata is not all text.");
  const tensors = new Map<string, Tensor>();
  let end = 0;
  for (const { name, description } of inFileOrder(descriptions)) {
    const { shape, data_offsets: offsets } = description;
    const size = shape.reduce((product, extent) => product * extent, 2);
    if (offsets[0] !== end || offsets[1] !== end + size) {
      throw new EnhancementError(
        `its weights' tensor ${quoted(name)} does not have the offsets that its shape implies.`,
      );
    }
    end = offsets[1];
    if (end > data.byteLength) throw new EnhancementError("its weights are truncated.");
    const halves = new Uint16Array(data.slice(offsets[0], end));
    if (halves.some((half) => (half & NOT_FINITE) === NOT_FINITE)) {
      throw new EnhancementError(`its weights' tensor ${quoted(name)} holds a value that is not a finite number.`);
    }
    tensors.set(name, { shape, halves });
  }
  if (end !== data.byteLength) throw new EnhancementError("its weights file has data after the last tensor.");
  return { metadata, tensors };
}

function parts(file: ArrayBuffer): [header: Record<string, unknown>, data: ArrayBuffer] {
  if (file.byteLength < 8) throw new EnhancementError("its weights are truncated.");
  const length = new DataView(file).getBigUint64(0, true);
  if (length > MAX_HEADER_BYTES) throw new EnhancementError("its weights' header is larger than 64 KiB.");
  const start = 8 + Number(length);
  if (start > file.byteLength) throw new EnhancementError("its weights are truncated.");
  try {
    const header: unknown = JSON.parse(new TextDecoder("utf-8", { fatal: true }).decode(file.slice(8, start)));
    return [v.parse(v.record(v.string(), v.unknown()), header), file.slice(start)];
  } catch {
    throw new EnhancementError("its weights are not a safetensors file.");
  }
}

function inFileOrder(descriptions: Record<string, unknown>) {
  return Object.entries(descriptions)
    .map(([name, description]) => {
      if (!v.is(Description, description)) {
        throw new EnhancementError(`its weights' tensor ${quoted(name)} is not declared as half-precision numbers.`);
      }
      return { name, description };
    })
    .sort((a, b) => a.description.data_offsets[1] - b.description.data_offsets[1]);
}

/** An untrusted name, quoted for use in a message. */
export function quoted(name: string): string {
  return JSON.stringify(name.length > 40 ? `${name.slice(0, 40)}…` : name);
}
