/** Any file dropped on the page as a movement is read or refused in a sentence. */

import fc from "fast-check";
import { expect, test } from "vitest";
import { EFFORT } from "#fakes/effort";
import { MovementError, type MovementTrace } from "./movement";
import { readMovement, readMovementFile, writeMovement } from "./movement-file";

const SOUND =
  "# anchor: start\n# unit: m\nt_ms,x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n20,0.5,0,0,0,0.7,0,0.7\n300,1,2,3,1,0,0,0\n";
const PIECES = [
  ...[
    ",",
    "\n",
    "\r\n",
    "\r",
    '"',
    "#",
    "# anchor: scene\n",
    "# unit: x\n",
    "\0",
    "\uFEFF",
    "\u0085",
    "\u2028",
    "NaN",
    "Infinity",
    "1e999",
  ],
  ...[
    "-1",
    "1e308",
    "1e-320",
    "0",
    "1_0",
    "0x10",
    "٣",
    "1e6",
    "t_ms",
    "ViewIndex",
    "86400001",
    "0,0,0,0,0,0,0,0\n",
    "y".repeat(11_000),
  ],
];

const edit = fc.record({
  at: fc.nat(SOUND.length),
  length: fc.constantFrom(0, 0, 1, 2, 8, 200),
  piece: fc.oneof(fc.constantFrom(...PIECES), fc.string({ maxLength: 8 })),
});
const texts = fc
  .array(edit, { maxLength: 4 })
  .map((edits) =>
    edits.reduce((text, { at, length, piece }) => text.slice(0, at) + piece + text.slice(at + length), SOUND),
  );

function expectSound(movement: MovementTrace): void {
  expect(movement.points[0]?.t_ms).toBe(0);
  expect(Number.isFinite(movement.duration)).toBe(true);
  for (const { position, quaternion } of movement.points) {
    expect(position.every(Number.isFinite)).toBe(true);
    expect(Math.hypot(...quaternion)).toBeCloseTo(1);
  }
  const again = readMovement(writeMovement(movement));
  expect([again.anchor, again.unit]).toEqual([movement.anchor, movement.unit]);
}

function expectSentence(error: unknown): void {
  expect(error).toBeInstanceOf(MovementError);
  expect((error as Error).message).toMatch(/^[^\n]{1,400}\.$/);
}

test("any text is a movement or one sentence", () => {
  fc.assert(
    fc.property(texts, (text) => {
      let movement: MovementTrace;
      try {
        movement = readMovement(text);
      } catch (error) {
        expectSentence(error);
        return;
      }
      expectSound(movement);
    }),
    EFFORT,
  );
});

test("any bytes of a file are a movement or one sentence", async () => {
  await fc.assert(
    fc.asyncProperty(fc.oneof(fc.uint8Array(), texts), async (content) => {
      const file = new File([content as BlobPart], "m.csv");
      await readMovementFile(file).then(expectSound, expectSentence);
    }),
    EFFORT,
  );
});
