import { describe, expect, test } from "vitest";
import { frameBytes } from "#fakes/frames";
import { parseFrame } from "./framing";
import { RequestProblem } from "./transport";

const HEADER = { status: 200, seq: 7, content_type: "image/jpeg", width: 4, height: 2, profile: 0, timing: null };

const image = Uint8Array.from({ length: 3000 }, (_, i) => i % 251);

test("a refusal becomes an error with the server's own sentence", () => {
  const problem = {
    type: "tigas:unknown-scene",
    title: "There is no such scene",
    status: 404,
    detail: "No scene “x”.",
  };
  const body = new TextEncoder().encode(JSON.stringify(problem));
  const header = { status: 404, seq: 7, content_type: "application/problem+json" };
  const parse = () => parseFrame([frameBytes(header, body)]);
  expect(parse).toThrow(RequestProblem);
  expect(parse).toThrow("No scene “x”.");
});

describe("what makes no sense is refused", () => {
  const length = (value: number) => {
    const bytes = new Uint8Array(4);
    new DataView(bytes.buffer).setUint32(0, value);
    return bytes;
  };
  test.each([
    ["nothing at all", []],
    ["half a length", [new Uint8Array(2)]],
    ["a header that is cut off", [frameBytes(HEADER, image).subarray(0, 40)]],
    ["a header of four gigabytes", [length(0xffffffff)]],
    ["a header that is no JSON", [length(3), new Uint8Array(3)]],
    ["a header without a status", [frameBytes({ seq: 1 }, image)]],
    ["null for a header", [length(4), new TextEncoder().encode("null")]],
  ])("%s", (_, chunks) => {
    expect(() => parseFrame(chunks)).toThrow();
  });
});
