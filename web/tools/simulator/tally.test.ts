import { expect, test } from "vitest";
import { PAPER_LADDER } from "#client/abr/ladder";
import { Tally } from "./tally";

test("poses and responses are in time up to 108 ms, as in the reports", () => {
  const tally = new Tally(PAPER_LADDER);
  tally.presented({
    side: "stateless",
    at: 0,
    pose: 1,
    rung: 0,
    width: 1280,
    height: 720,
    latencies: [100.1, 108, 108.1, 117],
  });
  for (const response of [100.1, 108, 108.1, 117]) tally.replied(response, 1000);
  const { inTime, responsesInTime } = tally.figures(1000, { count: 0, time: 0 });
  expect(inTime).toBe(0.5);
  expect(responsesInTime).toBe(0.5);
});
