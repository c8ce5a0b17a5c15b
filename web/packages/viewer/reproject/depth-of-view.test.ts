import { describe, expect, test } from "vitest";
import { orientation } from "../view/camera";
import { depthOfView, pointAt } from "./depth-of-view";

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

describe("point at", () => {
  const LENS = { fx: 100, fy: 100, cx: 100, cy: 50, width: 200, height: 100 };
  /** The left half is 2 units away, the right one 4, and the lower right corner infinitely far. */
  const DEPTH = { width: 2, height: 2, nearest: 0.5, codes: Uint8Array.of(255, 128, 255, 0) };

  test("a direction meets what is as far away as the depth says, from wherever the picture was taken", () => {
    const view = { ...LENS, position: [1, 0, 0] as const, quaternion: orientation(0, 0) };
    expect(pointAt(view, DEPTH, [-0.5, -0.1, 1])).toEqual([0, -0.2, 2]);
    expect(pointAt(view, DEPTH, [0.5, -0.1, 1])?.[2]).toBeCloseTo(3.98, 1);
    const turned = { ...view, quaternion: orientation(90, 0) };
    const [x, y, z] = pointAt(turned, DEPTH, [1, 0, 0.5]) ?? [];
    expect([x, y, z]).toEqual([expect.closeTo(3), expect.closeTo(0), expect.closeTo(1)]);
  });

  test.each<[string, [number, number, number]]>([
    ["infinitely far", [0.5, 0.1, 1]],
    ["beside the picture", [1.5, 0, 1]],
    ["behind the camera", [0, 0, -1]],
  ])("what is %s is nowhere", (_, direction) => {
    const view = { ...LENS, position: [0, 0, 0] as const, quaternion: orientation(0, 0) };
    expect(pointAt(view, DEPTH, direction)).toBeNull();
    expect(pointAt(view, null, [0, 0, 1]), "nor is anything without a depth").toBeNull();
  });
});
