import { expect, test } from "vitest";
import { depthOfView } from "./depth-of-view";

const LENS = { fx: 4, fy: 4, cx: 4, cy: 2, width: 8, height: 4 };
const DEPTH = { width: 8, height: 2, nearest: 0.5, codes: Uint8Array.from([...Array(16).keys()]) };

test("the same lens has the same depth, however many pixels", () => {
  expect(depthOfView(DEPTH, LENS, LENS)).toEqual(DEPTH);
  expect(depthOfView(DEPTH, LENS, { fx: 8, fy: 8, cx: 8, cy: 4, width: 16, height: 8 })).toEqual(DEPTH);
});

test("without its margins a picture has the depth of its middle", () => {
  const inner = { ...LENS, cx: 2, cy: 1, width: 4, height: 2 };
  expect([...depthOfView(DEPTH, LENS, inner).codes.slice(0, 8)]).toEqual([2, 2, 3, 3, 4, 4, 5, 5]);
});

test("beyond its edge a picture is as deep as there", () => {
  const wider = { ...LENS, cx: 8, width: 16 };
  expect([...depthOfView(DEPTH, LENS, wider).codes.slice(0, 8)]).toEqual([0, 0, 1, 3, 5, 7, 7, 7]);
});
