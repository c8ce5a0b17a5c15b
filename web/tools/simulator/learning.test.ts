/** LoL+ and L2A learn wherever the server is: the round trip is not taken from their buffer. */

import { expect, test } from "vitest";
import type { Controller, ControllerContext } from "#client/abr/controller";
import { L2aController } from "#client/abr/l2a";
import { PAPER_LADDER } from "#client/abr/ladder";
import { LolpController } from "#client/abr/lolp";
import { PaperEndpoints } from "./endpoints";
import { simulate } from "./simulate";
import { parseTrace } from "./trace";

const ROUND_TRIPS = [20, 50, 100, 200, 300];
const LOWEST = PAPER_LADDER.length - 1;

/** 20 s of a link of 64 Mbit/s; the controller afterwards, and the mean rung. */
async function visited<C extends Controller>(create: (context: ControllerContext) => C, roundTrip: number) {
  const made: C[] = [];
  const { rungOverTime } = await simulate({
    controller: (context) => {
      const controller = create(context);
      made.push(controller);
      return controller;
    },
    trace: parseTrace("t_ms,down_kbps\n0,64000\n"),
    ladder: PAPER_LADDER,
    duration: 20_000,
    roundTrip,
    endpoints: new PaperEndpoints(PAPER_LADDER, 1),
    seed: 1,
  });
  return { subject: made[0] as C, rung: rungOverTime };
}

test.each(ROUND_TRIPS)(
  "LoL+'s map moves, and it leaves the lowest rung, at a round trip of %i ms",
  async (roundTrip) => {
    const { subject, rung } = await visited((context) => new LolpController(context), roundTrip);
    for (const [, latency] of subject.learned.neurons) expect(latency).toBeGreaterThan(0);
    expect(rung).toBeLessThan(LOWEST - 0.5);
  },
);

test.each(ROUND_TRIPS)("L2A leaves start-up and the lowest rung at a round trip of %i ms", async (roundTrip) => {
  const { subject, rung } = await visited((context) => new L2aController(context), roundTrip);
  expect(subject.learned?.w.reduce((sum, p) => sum + p)).toBeCloseTo(1, 9);
  expect(rung).toBeLessThan(LOWEST - 0.5);
});
