import { expect, test } from "vitest";
import { looksOf } from "./looks";

test("each condition has one look, whatever it is compared with", () => {
  const budget = { mode: "stateless", profile: "budget" } as const;
  const tuned = { mode: "dash-tuned", profile: "budget" } as const;
  const [alone] = looksOf([budget]);
  const looks = looksOf([
    tuned,
    budget,
    { mode: "stateless", profile: 0 },
    { mode: "stateless", profile: 2 },
    { mode: "video", profile: "budget" },
    { mode: "video", profile: 1 },
  ]);
  expect(looks[1]).toEqual(alone);
  expect(new Set(looks.map(({ colour, line }) => colour + line)).size).toBe(looks.length);
});

test("what is as dark as the text in a report is as light as the text in a dark page", () => {
  expect(looksOf([{ mode: "dash-edge", profile: "budget" }])).toEqual([{ colour: "var(--text)", line: "dashed" }]);
});
