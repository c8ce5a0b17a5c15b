/** Frames in datagrams, subject to everything that a network or a stranger may do to them. */
import fc from "fast-check";
import { expect, test } from "vitest";
import { EFFORT } from "#fakes/effort";
import { fragments, frameBytes } from "#fakes/frames";
import { parseFrame } from "./framing";
import { FRAGMENT_HEADER_BYTES, Reassembler } from "./reassembly";

const WANTED = 4;

const bytes = (maxLength: number) => fc.uint8Array({ maxLength }) as fc.Arbitrary<Uint8Array<ArrayBuffer>>;
const frames = fc.array(fc.uint8Array({ minLength: 1, maxLength: 400 }), { minLength: 1, maxLength: WANTED });

test("what arrives whole is what was sent, whatever is lost, repeated, overtaken or made up", () => {
  fc.assert(
    fc.property(
      frames,
      fc.integer({ min: 1, max: 60 }),
      fc.array(bytes(40)),
      fc.infiniteStream(fc.nat()),
      (sent, size, made, dice) => {
        const roll = (sides: number) => dice.next().value % sides;
        const parts = sent.flatMap((frame, seq) => fragments(seq, frame, size));
        const arriving = [...parts, ...parts.filter(() => roll(4) === 0), ...made.map(withoutMeaning)].filter(
          () => roll(8) > 0,
        );
        const subject = new Reassembler((seq) => seq < WANTED);
        const seen = new Map<number, Set<number>>();
        for (let left = arriving.length; left > 0; left--) {
          const [datagram] = arriving.splice(roll(left), 1) as [Uint8Array<ArrayBuffer>];
          const whole = subject.add(datagram);
          expect(subject.partial).toBeLessThanOrEqual(WANTED);
          note(seen, datagram);
          if (whole === undefined) continue;
          expect(joined(whole.chunks)).toEqual(sent[whole.seq]);
          seen.delete(whole.seq);
        }
        for (const [seq, indices] of seen) {
          if (seq < sent.length)
            expect(indices.size, "a frame was kept back").toBeLessThan(Math.ceil((sent[seq]?.length ?? 0) / size));
        }
      },
    ),
    EFFORT,
  );
});

/** A datagram that answers none of our requests. */
function withoutMeaning(datagram: Uint8Array<ArrayBuffer>): Uint8Array<ArrayBuffer> {
  if (datagram.length > 0) datagram[0] = 255;
  return datagram;
}

function note(seen: Map<number, Set<number>>, datagram: Uint8Array<ArrayBuffer>): void {
  if (datagram.length <= FRAGMENT_HEADER_BYTES) return;
  const view = new DataView(datagram.buffer);
  const indices = seen.get(view.getUint32(0)) ?? new Set();
  seen.set(view.getUint32(0), indices.add(view.getUint16(4)));
}

function joined(chunks: readonly Uint8Array[]): Uint8Array {
  return Uint8Array.from(chunks.flatMap((chunk) => [...chunk]));
}

const header = fc.record({ status: fc.constant(200), seq: fc.nat(), content_type: fc.constant("image/jpeg") });

test("how a frame's bytes are cut changes nothing", async () => {
  await fc.assert(
    fc.asyncProperty(header, bytes(200), fc.array(fc.nat(60)), async (said, image, cuts) => {
      const { header: read, image: shown } = parseFrame(cut(frameBytes(said, image), cuts));
      expect([read, shown.type]).toEqual([said, "image/jpeg"]);
      expect(new Uint8Array(await shown.arrayBuffer())).toEqual(image);
    }),
    EFFORT,
  );
});

test("any bytes are a frame or an error", () => {
  const odd = fc.oneof(
    bytes(100),
    fc.tuple(fc.json(), bytes(50)).map(([json, body]) => frameBytes(JSON.parse(json) ?? {}, body)),
  );
  fc.assert(
    fc.property(odd, fc.array(fc.nat(60)), (content, cuts) => {
      try {
        expect(Number.isInteger(parseFrame(cut(content, cuts)).header.status)).toBe(true);
      } catch (error) {
        expect(error).toBeInstanceOf(Error);
        expect(error).not.toBeInstanceOf(TypeError);
        expect(error).not.toBeInstanceOf(RangeError);
      }
    }),
    EFFORT,
  );
});

/** The same bytes in pieces of these lengths, some of them empty. */
function cut(content: Uint8Array<ArrayBuffer>, lengths: readonly number[]): Uint8Array<ArrayBuffer>[] {
  const pieces = [];
  let at = 0;
  for (const length of lengths) {
    pieces.push(content.subarray(at, at + length));
    at += length;
  }
  return [...pieces, content.subarray(at)];
}
