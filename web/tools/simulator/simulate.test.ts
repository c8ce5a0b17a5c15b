import { describe, expect, test } from "vitest";
import type { Way } from "#client/abr/controller";
import { PAPER_LADDER } from "#client/abr/ladder";
import { seenOfRung } from "#client/abr/seen-error";
import type { Rung } from "#client/wire/render";
import type { TimedPose } from "#viewer/movement/movement";
import courtyard from "../../../services/render/tigas_render/scenes/demo/ladder.json";
import { controllerFactory } from "./controllers";
import { PaperEndpoints, type PaperOptions } from "./endpoints";
import { Head } from "./head";
import { overTraces, table } from "./report";
import { simulate } from "./simulate";
import { parseTrace } from "./trace";

function visit(
  controller: string,
  rate: number | string,
  options: {
    seed?: number;
    roundTrip?: number | null;
    paper?: PaperOptions;
    way?: Way;
    head?: Head;
    ladder?: readonly Rung[];
  } = {},
) {
  const { ladder = PAPER_LADDER } = options;
  const trace = parseTrace(typeof rate === "string" ? rate : `t_ms,down_kbps\n0,${rate * 1000}\n`);
  return simulate({
    controller: controllerFactory(controller),
    trace,
    ladder,
    duration: 20_000,
    roundTrip: 20,
    endpoints: new PaperEndpoints(ladder, options.seed ?? 1, options.paper),
    seed: 1,
    ...options,
  });
}

test("the same options give the same figures, another seed others", async () => {
  const once = await visit("lol+", 20);
  expect(await visit("lol+", 20)).toEqual(once);
  expect(await visit("lol+", 20, { seed: 2 })).not.toEqual(once);
});

test("on a fast link a frame takes the round trip, the server's time and its transmission", async () => {
  const { responseP50, age, framesPerSecond, rung, rungOverTime } = await visit("fixed:3", 100);
  // 20 + 11 + 1/16 + 7 kB at 100 Mbit/s, and the request's own path
  expect(responseP50).toBeGreaterThan(31);
  expect(responseP50).toBeLessThan(34);
  // decoded 4 ms later, taken in one of the animation frames and on the screen in the next
  expect(age).toBeGreaterThan(responseP50 + 4 + 1000 / 60);
  expect(age).toBeLessThan(responseP50 + 4 + 2 * (1000 / 60));
  expect(framesPerSecond).toBeGreaterThan(55);
  expect(rung).toBe(3);
  expect(rungOverTime).toBeCloseTo(3, 9);
});

test("a link carries up to its rate, and waiting grows with the load", async () => {
  const { bandwidth, framesPerSecond, responseP50 } = await visit("fixed:0", 20);
  expect(bandwidth).toBeLessThan(20);
  expect(bandwidth).toBeGreaterThan(15);
  expect(framesPerSecond).toBeGreaterThan(9); // 20 Mbit/s are 10.4 frames of 240 kB a second, less headers
  expect(framesPerSecond).toBeLessThan(10.4);
  expect(responseP50).toBeGreaterThan(150); // 96 ms on the link, and the wait for the frame before
});

test.each([
  [2, 20],
  [100, 20],
  [300, 20],
  [2, 60],
  [300, 60],
])("the frame rate does not fall with the round trip: %i ms, and %i ms in the server", async (roundTrip, render) => {
  const { framesPerSecond, responseP50 } = await visit("fixed:2", 20, { roundTrip, paper: { render } });
  expect(framesPerSecond).toBeGreaterThan(0.85 * (1000 / (render + 8)));
  expect(responseP50).toBeGreaterThan(roundTrip + render);
});

test("poses that are never shown are late, and their wait a stall", async () => {
  const trace = "t_ms,down_kbps,up_kbps\n0,20000,10000\n10000,0,0\n20000,,\n";
  const { inTime, photonP95, stalls, stalled } = await visit("fixed:3", trace);
  expect(inTime).toBeGreaterThan(0.45);
  expect(inTime).toBeLessThan(0.51);
  expect(photonP95).toBeGreaterThan(8000);
  expect(stalls).toBe(3); // one in a third of a minute
  expect(stalled).toBeCloseTo(0.5, 1);
});

test("an outage is a stall, and frames come again afterwards", async () => {
  const { stalls, framesPerSecond } = await visit(
    "fixed:3",
    "t_ms,down_kbps,up_kbps\n0,20000,10000\n8000,0,0\n10000,20000,10000\n20000,,\n",
  );
  expect(stalls).toBe(3); // one in a third of a minute
  expect(framesPerSecond).toBeGreaterThan(40);
});

test("Latency that counts transfers alone fills the link; with a lower target, or per request, it is in time more often", async () => {
  const [transfer, cautious, request] = await Promise.all([
    visit("latency-transfer", 24),
    visit("latency-transfer@target=15", 24),
    visit("latency", 24),
  ]);
  expect(transfer.inTime).toBeLessThan(0.5);
  expect(cautious.inTime).toBeGreaterThan(transfer.inTime);
  expect(request.inTime).toBeGreaterThan(0.9);
});

test("2 kB frames, a round trip of 50 ms and a page that hears of packets every 4 ms do not keep Seen low", async () => {
  const { rungOverTime, photonP95 } = await visit("seen", 24, {
    roundTrip: 50,
    paper: { scale: 0.3, batch: 4 },
    way: "stale",
  });
  expect(rungOverTime).toBeLessThan(2);
  expect(photonP95).toBeLessThan(140);
});

test("a picture gets worse the later it is and the worse late frames are shown", async () => {
  const [near, far] = await Promise.all([visit("fixed:3", 100), visit("fixed:3", 100, { roundTrip: 200 })]);
  expect(far.contentAge - near.contentAge).toBeCloseTo(180, -1);
  expect(near.contentAge).toBeGreaterThan(near.age);
  expect(far.viewError).toBeGreaterThan(near.viewError);
  const stale = await visit("fixed:3", 100, { way: "stale" });
  expect(stale.viewPsnr).toBeLessThan(near.viewPsnr - 3);
});

describe("the demo scene's ladder", () => {
  const LADDER = courtyard.rungs as Rung[];
  const lines = (kept: Awaited<ReturnType<typeof visit>>) => [kept.linesAt500, kept.linesAt1000, kept.linesAt5000];

  test("a good link shows a large picture after half a second", async () => {
    const near = await visit("seen", 50, { ladder: LADDER });
    for (const each of lines(near)) expect(each).toBeGreaterThanOrEqual(540);
    const far = await visit("seen", 50, { ladder: LADDER, roundTrip: 100 });
    expect(far.linesAt1000).toBeGreaterThanOrEqual(540);
  });

  test("a poor one does not, and is not stalled by the attempt", async () => {
    const { linesAt5000, framesPerSecond, viewSsim } = await visit("seen", 1, { ladder: LADDER });
    expect(linesAt5000).toBeLessThanOrEqual(360);
    expect(framesPerSecond).toBeGreaterThan(4);
    expect((await visit("seen", 1, { ladder: LADDER, way: "stale" })).stalls).toBe(0);
    expect(viewSsim).toBeGreaterThan((await visit("fixed:0", 1, { ladder: LADDER })).viewSsim);
  });

  // 640×360 in 30 ms, 1280×720 in 102: roughly the speed of two cores
  test.each(["stale", "predicted"] as const)(
    "a processor that renders near by is asked for as much as it can do: %s",
    async (way) => {
      const paper = { render: 6, renderBest: 102 };
      const kept = await visit("seen", 1000, { ladder: LADDER, roundTrip: 1, paper, way });
      for (const each of lines(kept)) expect(each).toBeGreaterThanOrEqual(way === "stale" ? 144 : 360);
      expect(kept.framesPerSecond).toBeGreaterThan(way === "stale" ? 50 : 10);
    },
  );

  test("a processor that takes long for any frame is not asked for the smallest, which gain nothing", async () => {
    const options = { ladder: LADDER, roundTrip: 1, paper: { render: 60, renderBest: 160 }, way: "stale" } as const;
    const [kept, smallest] = [await visit("seen", 1000, options), await visit("fixed:9", 1000, options)];
    expect(kept.rungOverTime).toBeLessThan(8);
    expect(kept.viewSsim).toBeGreaterThan(smallest.viewSsim - 0.01);
    expect(kept.viewPsnr).toBeGreaterThan(smallest.viewPsnr - 0.3);
  });

  test("where late frames are turned, pictures that take longer are seen better", async () => {
    const rate = "t_ms,down_kbps\n0,24000\n7000,8000\n13000,40000\n";
    const turned = await visit("seen", rate, { ladder: LADDER, way: "predicted" });
    const lowest = await visit("fixed:9", rate, { ladder: LADDER, way: "predicted" });
    expect(turned.viewSsim).toBeGreaterThan(lowest.viewSsim + 0.05);
    const asItComes = await visit("seen", rate, { ladder: LADDER, way: "stale" });
    expect(turned.halvings).toBeLessThan(asItComes.halvings);
  });
});

test("the camera turns as somebody's head did", async () => {
  const points = [0, 90].map((degrees, i) => {
    const half = (degrees * Math.PI) / 360;
    return { t_ms: 20_000 * i, position: [0, 0, 0], quaternion: [0, Math.sin(half), 0, Math.cos(half)] } as TimedPose;
  });
  const slow = await visit("fixed:3", 100, { head: new Head(points, 0), way: "stale" });
  const still = await visit("fixed:3", 100, { head: new Head(points.slice(0, 1), 0), way: "stale" });
  expect(still.viewSsim).toBeCloseTo(seenOfRung(PAPER_LADDER[3] as Rung).ssim, 9);
  expect(slow.viewSsim).toBeLessThan(still.viewSsim);
});

test("a table of runs, and of their mean over traces", async () => {
  const figures = await visit("fixed:3", 20);
  const run = { controller: "fixed:3", roundTrip: 20, figures };
  const runs = [
    { ...run, trace: "a" },
    { ...run, trace: "b", figures: { ...figures, framesPerSecond: 0 } },
  ];
  const [mean] = overTraces(runs);
  expect(mean?.figures.framesPerSecond).toBeCloseTo(figures.framesPerSecond / 2, 9);
  expect(mean?.figures.responseP95).toBeCloseTo(figures.responseP95, 9);
  expect(table(runs).split("\n")).toHaveLength(4);
});

test("LoL+ and L2A take other parameters than their authors'", async () => {
  const names = ["l2a", "l2a@target=400,horizon=16", "lol+", "lol+@safety=0.5"];
  const [l2a, patient, lolp, cautious] = await Promise.all(names.map((name) => visit(name, 24)));
  expect(patient?.bandwidth).not.toBe(l2a?.bandwidth);
  expect(cautious?.bandwidth).toBeLessThan(lolp?.bandwidth ?? 0);
});

test("an unknown controller is refused with a sentence", () => {
  expect(() => controllerFactory("bola")).toThrow(/not a controller/);
  expect(() => controllerFactory("fixed:best")).toThrow(/not a controller/);
  expect(() => controllerFactory("latency@target=0")).toThrow(/not a controller/);
  expect(() => controllerFactory("l2a@target=50,speed=2")).toThrow(/not a controller/);
  expect(() => controllerFactory("seen@target=50")).toThrow(/not a controller/);
});
