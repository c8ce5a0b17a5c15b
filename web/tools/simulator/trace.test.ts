import { expect, test } from "vitest";
import { parseTrace, TracePlayer } from "./trace";

const TEXT =
  "t_ms,down_kbps,up_kbps,delay_ms,jitter_ms,loss_pct\n0,20000,10000,20,,\n1000,0,0,,,\n1500,20000,9000,,,\n2000,,,,,\n";

test("an empty cell means as before, a last line with nothing but a time is the end", () => {
  const { steps, duration } = parseTrace(TEXT);
  expect(duration).toBe(2000);
  expect(steps.map(({ down_kbps, delay_ms }) => [down_kbps, delay_ms])).toEqual([
    [20_000, 20],
    [0, 20],
    [20_000, 20],
  ]);
});

test("without an end the last state lasts as long as the one before", () => {
  expect(parseTrace("t_ms,down_kbps\n0,5\n300,6\n").duration).toBe(600);
  expect(parseTrace("t_ms,down_kbps\n0,5\n").duration).toBe(1000);
});

test.each([
  ["", /no steps/],
  ["t_ms,down_kbps\n0,fast\n", /Line 2/],
  ["t_ms,down_kbps\n0,5\n0,6\n", /Line 3/],
  ["t_ms,up_kbps\n0,5\n", /Line 2/],
  ["t_ms,down_kbps\n0,0\n", /never/],
])("%j is refused with a sentence", (text, reason) => {
  expect(() => parseTrace(text)).toThrow(reason);
});

test("played round and round", () => {
  const player = new TracePlayer(parseTrace(TEXT));
  expect([0, 999, 1000, 1600, 2000, 3200, 9000].map((time) => player.at(time).down_kbps)).toEqual([
    20_000, 20_000, 0, 20_000, 20_000, 0, 0,
  ]);
});
