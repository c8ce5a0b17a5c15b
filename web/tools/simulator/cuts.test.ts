import { expect, test } from "vitest";
import { seeded } from "#client/abr/random";
import { cut, segments } from "./cuts";
import { parseTrace } from "./trace";

const TRACE = parseTrace("t_ms,down_kbps,delay_ms\n0,100,5\n1500,200,\n4000,0,\n6000,300,7\n8000,,\n");

test("a part begins with the state that holds there", () => {
  expect(cut(TRACE, 2000, 5000)).toMatchObject({
    duration: 5000,
    steps: [
      { t_ms: 0, down_kbps: 200, delay_ms: 5 },
      { t_ms: 2000, down_kbps: 0 },
      { t_ms: 4000, down_kbps: 300, delay_ms: 7 },
    ],
  });
});

test("parts differ, come from all traces in turn, and let something through", () => {
  const traces = [
    { name: "a", trace: TRACE },
    { name: "b", trace: parseTrace("t_ms,down_kbps\n0,100\n2000,,\n") },
  ];
  const chosen = segments(traces, 9, 2000, seeded(1));
  expect(chosen.map(({ name }) => name)).toEqual(["a", "b", "a", "a"]);
  expect(
    chosen
      .filter(({ name }) => name === "a")
      .map(({ start }) => start)
      .toSorted(),
  ).toEqual([0, 2000, 6000]);
  expect(segments(traces, 2, 2000, seeded(1))).toEqual(chosen.slice(0, 2));
});
