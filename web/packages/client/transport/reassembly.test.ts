import { describe, expect, test } from "vitest";
import { fragment as datagramOf } from "#fakes/frames";
import { Reassembler } from "./reassembly";

function fragment(seq: number, index: number, count: number, content = `${seq}.${index}`): Uint8Array<ArrayBuffer> {
  return datagramOf(seq, index, count, new TextEncoder().encode(content));
}

const text = (chunks: readonly Uint8Array[] | undefined) => chunks?.map((chunk) => new TextDecoder().decode(chunk));
const everything = () => true;

test("a frame with a lost fragment stays partial until it is dropped", () => {
  const subject = new Reassembler(everything);
  subject.add(fragment(1, 0, 3));
  subject.add(fragment(1, 2, 3));
  expect(subject.partial).toBe(1);
  subject.drop(1);
  expect(subject.partial).toBe(0);
});

test("a datagram inside a larger buffer is read at its own place", () => {
  const alone = fragment(5, 0, 1);
  const buffer = new Uint8Array(alone.length + 3);
  buffer.set(alone, 3);
  expect(text(new Reassembler(everything).add(buffer.subarray(3))?.chunks)).toEqual(["5.0"]);
});

describe("hostile datagrams take no memory and break nothing", () => {
  test.each([
    ["empty", new Uint8Array()],
    ["shorter than its header", new Uint8Array(7)],
    ["a header without content", fragment(1, 0, 1, "")],
    ["no fragments at all", fragment(1, 0, 0)],
    ["a number beyond the count", fragment(1, 5, 5)],
    ["a frame that nobody asked for", fragment(666, 0, 2)],
  ])("%s", (_, datagram) => {
    const subject = new Reassembler((seq) => seq === 1);
    expect(subject.add(datagram)).toBeUndefined();
    expect(subject.partial).toBe(0);
  });

  test("a fragment that disagrees about the count is ignored", () => {
    const subject = new Reassembler(everything);
    subject.add(fragment(1, 0, 2));
    expect(subject.add(fragment(1, 1, 60_000))).toBeUndefined();
    expect(text(subject.add(fragment(1, 1, 2))?.chunks)).toEqual(["1.0", "1.1"]);
  });

  test("a flood of made-up frames leaves nothing behind", () => {
    const subject = new Reassembler((seq) => seq < 4);
    for (let seq = 0; seq < 10_000; seq++) subject.add(fragment(seq, 0, 65_535));
    expect(subject.partial).toBe(4);
  });
});
