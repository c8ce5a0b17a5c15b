import { beforeEach, expect, test } from "vitest";
import { LatencyTarget } from "./latency-target";

const FRAME = 1000 / 30;

let target: LatencyTarget;
let at: number;
let mediaTime: number;
/** All targets that were set. */
let heard: number[];

beforeEach(() => {
  target = new LatencyTarget(120);
  at = mediaTime = 0;
  heard = [];
});

/** Shows a frame this many milliseconds after the previous one, and this far on in the stream. */
function show(after: number, further = FRAME): void {
  at += after;
  mediaTime += further / 1000;
  if (target.presented(at, mediaTime)) heard.push(target.value);
}

function playSmoothly(milliseconds: number): void {
  for (let played = 0; played < milliseconds; played += FRAME) show(FRAME);
}

function stall(): void {
  show(FRAME + 60);
}

test("two stalls within ten seconds raise it, one does not", () => {
  playSmoothly(5000);
  stall();
  playSmoothly(9000);
  expect(heard).toEqual([]);
  stall();
  expect(heard).toEqual([170]);
  playSmoothly(11_000);
  stall(); // the first of the next two
  playSmoothly(11_000);
  stall();
  expect(heard).toEqual([170]);
});

test("half a minute without a stall lowers it, not below the preset's", () => {
  playSmoothly(3000);
  stall();
  stall();
  playSmoothly(29_000);
  expect(heard).toEqual([170]);
  playSmoothly(2000);
  expect(heard).toEqual([170, 145]);
  playSmoothly(90_000);
  expect(heard).toEqual([170, 145, 120]);
});

test("what lasts longer in the stream, was not heard of, or was skipped is no stall", () => {
  playSmoothly(3000);
  for (let i = 0; i < 3; i++) show(8 * FRAME, 8 * FRAME);
  for (let i = 0; i < 3; i++) show(FRAME, 1000);
  expect(heard).toEqual([]);
});

test("neither is the time in which a page was hidden, nor a stream's beginning", () => {
  for (let i = 0; i < 4; i++) stall();
  playSmoothly(3000);
  for (let i = 0; i < 4; i++) {
    target.forget();
    show(5000);
  }
  expect(heard).toEqual([]);
});

test("it has an end", () => {
  playSmoothly(3000);
  for (let i = 0; i < 200; i++) stall();
  expect(target.value).toBe(2000);
});
