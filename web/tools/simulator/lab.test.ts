import { expect, test } from "vitest";
import { PAPER_LADDER } from "#client/abr/ladder";
import { controllerFactory } from "./controllers";
import { agreement, conditions, type LabRun, MeasuredEndpoints, offered, spearman } from "./lab";
import { simulate } from "./simulate";
import type { Figures } from "./tally";

const RUN: LabRun = {
  network: "lte.csv",
  roundTrip: 40,
  controller: "latency",
  pixels: 640 * 360,
  seed: 1,
  duration: 4000,
  displayInterval: 20,
  ladder: PAPER_LADDER,
  frames: [
    { rung: 2, bytes: 20_000, render: 30, encode: 3 },
    { rung: 3, bytes: 5000, render: 10, encode: 1 },
  ],
  link: [
    { at: -50, target_kbps: 8000 },
    { at: 250, target_kbps: 8000 },
    { at: 1000, target_kbps: 2000 },
  ],
  points: [{ t_ms: 0, position: [0, 0, 0], quaternion: [0, 0, 0, 1] }],
  figures: {},
};

test("frames take what frames of their rung took, or of the nearest one at the ladder's ratio of bytes", () => {
  const endpoints = new MeasuredEndpoints(RUN, RUN.frames, 1);
  expect([endpoints.render(2), endpoints.encode(2), endpoints.bytes(2, 0)]).toEqual([30, 3, 20_000]);
  expect([endpoints.render(3), endpoints.encode(3)]).toEqual([10, 1]);
  expect(endpoints.render(0)).toBe(30);
  const ratio = (PAPER_LADDER[0]?.expected_kb ?? 0) / (PAPER_LADDER[2]?.expected_kb ?? 1);
  expect(endpoints.bytes(0, 0)).toBe(Math.round(20_000 * ratio));
  expect(endpoints.nextAnimationFrame(100)).toBe(120);
});

test("the link has the run's rates and round trip, from the run's beginning", () => {
  const { steps, duration } = conditions(RUN).trace;
  expect(steps.map(({ t_ms, down_kbps, delay_ms }) => [t_ms, down_kbps, delay_ms])).toEqual([
    [0, 8000, 20],
    [1000, 2000, 20],
  ]);
  expect(duration).toBe(4000);
});

test("a link that does not change has its own way up, jitter and losses", () => {
  const [step] = conditions({ ...RUN, constant: { up_kbps: 500, jitter_ms: 3, loss_pct: 1 } }).trace.steps;
  expect(step).toMatchObject({ up_kbps: 500, jitter_ms: 3, loss_pct: 1, delay_ms: 20, down_kbps: 8000 });
});

test("a run is played with rungs that fit its viewport", async () => {
  const { inTime, bandwidth, responseP50 } = await simulate({
    controller: offered(controllerFactory("fixed:0"), RUN),
    ...conditions(RUN),
    ladder: RUN.ladder,
    duration: RUN.duration,
    roundTrip: null,
    endpoints: new MeasuredEndpoints(RUN, RUN.frames, 1),
    seed: 1,
  });
  expect(bandwidth).toBeLessThan(8);
  expect(responseP50).toBeGreaterThan(40 + 30 + 3);
  expect(inTime).toBeLessThan(1);
});

test("agreement has means, errors and ranks, of controllers within each network", () => {
  const runs = [
    ["a", 20, "latency", 100, 110],
    ["a", 20, "l2a", 200, 190],
    ["b", 20, "latency", 50, 40],
    ["b", 20, "l2a", 40, 60],
  ] as const;
  const [row] = agreement(
    runs.map(([network, roundTrip, controller, lab, simulated]) => ({
      ...RUN,
      network,
      roundTrip,
      controller,
      figures: { motion_to_photon_p50_ms: lab },
      simulated: { photonP50: simulated } as Figures,
    })),
  ).filter(({ title }) => title.startsWith("motion to photon p50"));
  expect(row).toMatchObject({ lab: 97.5, simulated: 100, error: 12.5, controllers: 0 });
  expect(row?.runs).toBeCloseTo(0.8);
});

test("equal values share a rank", () => {
  expect(spearman([1, 2, 2, 3], [10, 20, 20, 30])).toBeCloseTo(1);
  expect(spearman([1, 2, 3], [3, 2, 1])).toBeCloseTo(-1);
});
