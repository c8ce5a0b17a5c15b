import { expect, test } from "vitest";
import { Bottleneck, QUEUE_MS } from "./bottleneck";
import { parseTrace } from "./trace";

// 8000 kbit/s are 1000 bytes a millisecond.
const STEADY = parseTrace("t_ms,down_kbps\n0,8000\n1000,\n");
const OUTAGE = parseTrace("t_ms,down_kbps\n0,8000\n10,0\n20,8000\n30,\n");

test("packets leave one after another at the link's rate", () => {
  const link = new Bottleneck(STEADY, "down_kbps");
  expect([link.offer(1000, 0), link.offer(2000, 0.5), link.offer(1000, 10)]).toEqual([1, 3, 11]);
});

test("in an outage they wait for its end", () => {
  const link = new Bottleneck(OUTAGE, "down_kbps");
  expect(link.offer(1000, 9.5)).toBeCloseTo(20.5, 9);
  expect(link.drained).toBeCloseTo(20.5, 9);
});

test("the trace starts again at its end", () => {
  const link = new Bottleneck(OUTAGE, "down_kbps");
  expect(link.offer(1000, 39)).toBeCloseTo(40, 9);
  expect(link.offer(1000, 39)).toBeCloseTo(51, 9);
});

test("a full queue drops, and takes packets again once it has drained", () => {
  const link = new Bottleneck(STEADY, "down_kbps");
  const taken = Array.from({ length: 200 }, () => link.offer(1000, 0)).filter((departure) => departure !== null);
  expect(taken).toHaveLength(QUEUE_MS);
  expect(link.offer(1000, 1)).toBe(QUEUE_MS + 1);
});
