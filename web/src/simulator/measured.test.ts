import { expect, test } from "vitest";
import { ANIMATION_FRAME } from "./endpoints";
import { MeasuredEndpoints } from "./measured";

const RUNGS = [
  { render_ms: 40, encode_ms: 5, page_ms: 6 },
  { render_ms: 10, encode_ms: 1, page_ms: 2 },
];
const MEASURED = {
  rungs: RUNGS,
  views: [
    { t_ms: 0, bytes: [9000, 300] },
    { t_ms: 500, bytes: [8000, 200] },
  ],
  animation: [
    { t_ms: 3, turning: 10 },
    { t_ms: 40, turning: 20 },
  ],
};

function parse(changes: object = {}): MeasuredEndpoints {
  return MeasuredEndpoints.parse(JSON.stringify({ ...MEASURED, ...changes }), 2);
}

test("each rung has its own times, and each view its own sizes", () => {
  const measured = parse();
  expect([measured.render(0), measured.encode(1), measured.decode(1)]).toEqual([40, 1, 2]);
  expect([0, 499, 500, 9000].map((now) => measured.bytes(1, now))).toEqual([300, 300, 200, 200]);
});

test("the page draws when it drew, and 60 times a second afterwards", () => {
  const measured = parse();
  expect([0, 3, 40].map((now) => measured.nextAnimationFrame(now))).toEqual([3, 40, 40 + ANIMATION_FRAME]);
});

test("the camera turns as it did in the last animation frame", () => {
  const measured = parse();
  expect([0, 3, 39, 40, 9000].map((now) => measured.turning(now))).toEqual([0, 10, 10, 20, 20]);
});

test.each([
  ["a missing rung", { rungs: RUNGS.slice(1) }],
  ["a view without a rung", { views: [{ t_ms: 0, bytes: [1] }] }],
  ["no views", { views: [] }],
  ["a negative time", { rungs: [RUNGS[0], { ...RUNGS[1], render_ms: -1 }] }],
])("%s is refused", (_, changes) => {
  expect(() => parse(changes)).toThrow();
});
