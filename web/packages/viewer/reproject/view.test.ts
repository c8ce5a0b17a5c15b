import { expect, test } from "vitest";
import { fakeView, turned } from "#fakes/views";
import { add, conjugate, type Quaternion, rotate, subtract, type Vector3 } from "../view/vector";
import { cropFor, resized, transfer, transferred, type View, viewOfFrame } from "./view";

test("a picture of another size has the same field of view", () => {
  expect(resized(fakeView(), 320, 45)).toEqual(
    fakeView({ fx: 200, fy: 50, cx: 160, cy: 22.5, width: 320, height: 45 }),
  );
});

test("a frame's margins widen its view at the same pixels per angle", () => {
  const frame = viewOfFrame(fakeView(), { width: 320 + 64, height: 180 + 36, marginX: 32, marginY: 18 });
  expect(frame).toEqual(fakeView({ fx: 200, fy: 200, cx: 192, cy: 108, width: 384, height: 216 }));
});

const VIEW = fakeView();
const FRAME = viewOfFrame(VIEW, { width: 200, height: 110, marginX: 20, marginY: 10 });

test("a view is a frame without its margins", () => {
  expect(cropFor(VIEW, VIEW, 1)).toEqual({ x: 0, y: 0 });
  expect(cropFor(FRAME, VIEW, 1)).toEqual({ x: 20, y: 10 });
});

test.each<[string, View]>([
  ["turned by a tenth of a pixel", { ...VIEW, ...turned(0.06) }],
  ["a tenth of a pixel aside, as the nearest thing sees it", { ...VIEW, position: [0.001, 0, 0] }],
  ["closer", { ...VIEW, position: [0, 0, 0.01] }],
  ["of another lens", { ...VIEW, fx: 101 }],
  ["half a pixel aside", { ...VIEW, cx: 80.5 }],
  ["enlarged", resized(VIEW, 320, 180)],
  ["upside down", { ...VIEW, quaternion: [0, 0, 1, 0] }],
  ["wider than the frame", { ...VIEW, width: 240, cx: 120 }],
])("a view that is %s is not", (_, view) => {
  expect(cropFor(FRAME, view, 1)).toBeNull();
});

test("a pose that was rounded on its way is the same pose", () => {
  const rounded = { ...VIEW, position: [1e-6, 0, 0], quaternion: [0, -1e-6, 0, -1] } as const;
  expect(cropFor(FRAME, rounded, 1)).toEqual({ x: 20, y: 10 });
});

test("where all is infinitely far, a step changes nothing", () => {
  expect(cropFor(FRAME, { ...VIEW, position: [5, 0, 0] }, 0)).toEqual({ x: 20, y: 10 });
});

const ODD: Quaternion = [0.03, 0.15, 0.05, Math.sqrt(1 - 0.0259)];
const INVERSE_DEPTHS = [0, 0.01, 0.5, 2];

/** Slow reference: to the point in the scene, and from there to the other view's picture. */
function seenBy(from: View, to: View, u: number, v: number, depth: number): [number, number] {
  const inFrom: Vector3 = [((u - from.cx) / from.fx) * depth, ((v - from.cy) / from.fy) * depth, depth];
  const point = add(rotate(from.quaternion, inFrom), from.position);
  const [x, y, z] = rotate(conjugate(to.quaternion), subtract(point, to.position));
  return [(x / z) * to.fx + to.cx, (y / z) * to.fy + to.cy];
}

function expectAt(pixel: [number, number] | null, [u, v]: readonly [number, number]): void {
  expect(pixel?.[0]).toBeCloseTo(u, 6);
  expect(pixel?.[1]).toBeCloseTo(v, 6);
}

test("after a turn of 45° to the right the old centre is one focal length to the left", () => {
  const toTurned = transfer(fakeView(), fakeView(turned(45)));
  for (const inverseDepth of INVERSE_DEPTHS) expectAt(transferred(toTurned, 80, 45, inverseDepth), [80 - 100, 45]);
});

test("after a step to the right near things move left, and infinitely far ones stay", () => {
  const toMoved = transfer(fakeView(), fakeView({ position: [0.5, 0, 0] }));
  expectAt(transferred(toMoved, 30, 20, 1), [30 - 50, 20]);
  expectAt(transferred(toMoved, 30, 20, 0), [30, 20]);
});

test("halfway to an object it is twice as large", () => {
  expectAt(transferred(transfer(fakeView(), fakeView({ position: [0, 0, 2] })), 90, 50, 1 / 4), [100, 55]);
});

test("any view's pixels lie where the slow way says", () => {
  const from = fakeView({ position: [1, 2, 3], ...turned(20), cx: 70, fy: 110 });
  const to = fakeView({ position: [1.2, 1.9, 3.3], quaternion: ODD, fx: 200, fy: 210, cx: 150, width: 320 });
  for (const [u, v] of [
    [0, 0],
    [160, 90],
    [17.5, 60.25],
  ] as const) {
    for (const depth of [1, 5, 1000]) {
      expectAt(transferred(transfer(from, to), u, v, 1 / depth), seenBy(from, to, u, v, depth));
    }
  }
});

test("what is behind the camera has no pixel", () => {
  expect(transferred(transfer(fakeView(), fakeView(turned(180))), 80, 45, 0)).toBeNull();
  expect(transferred(transfer(fakeView(), fakeView({ position: [0, 0, 2] })), 80, 45, 1)).toBeNull();
});
