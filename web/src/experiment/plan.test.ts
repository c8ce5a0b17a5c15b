import { expect, test } from "vitest";
import labels from "../../../tests/experiments/wire/network_labels.golden.json";
import { DEFAULT_SETTINGS, validSettings } from "../state/settings";
import { MODES } from "../wire/run";
import type { RunRow } from "../wire/store";
import { experimentPlan } from "./fake-plan";
import {
  conditionLabel,
  constantLink,
  isLocal,
  missingRuns,
  networkLabel,
  readPlan,
  runsOf,
  settingsFor,
  timeFor,
  UNSHAPED,
} from "./plan";

const PLAN = experimentPlan({
  name: "bus",
  network: { link: null, trace: "4g-bus", rtt_ms: 100 },
  modes: ["stateless", "dash-tuned"],
  profiles: ["latency", "budget", 1],
  repeats: 2,
  duration_s: 20,
  warm_up_s: 3,
  sample_stride: 30,
});

test("repeats all of them, not each of them, and multiplies only the stateless mode by the controllers", () => {
  const runs = runsOf(PLAN).map((run) => [run.repeat, conditionLabel(run)]);
  const once = ["Latency", "Budget", "Fixed: profile 1", "DASH, tuned"];
  expect(runs).toEqual([...once.map((name) => [0, name]), ...once.map((name) => [1, name])]);
});

test("the mode video has the controllers of the mode stateless, and takes no samples", () => {
  const runs = runsOf({ ...PLAN, modes: ["video", "stateless"], repeats: 1 });
  expect(runs.map((run) => conditionLabel(run))).toEqual([
    ...["Video, Latency", "Video, Budget", "Video, Fixed: profile 1"],
    ...["Latency", "Budget", "Fixed: profile 1"],
  ]);
  expect(runs.map(({ sample_stride }) => sample_stride)).toEqual([0, 0, 0, 30, 30, 30]);
  expect(runs.map((run) => settingsFor(run).mode)).toEqual(["video", "video", "video", ...Array(3).fill("stateless")]);
});

test("a run says all that must be known to make it again", () => {
  expect(runsOf(PLAN)[0]).toEqual({
    scene: "courtyard",
    movement: "stroll",
    network: { link: null, trace: "4g-bus", rtt_ms: 100, offset_s: 0 },
    movement_offset_s: 0,
    segment: 0,
    mode: "stateless",
    profile: "latency",
    seed: 1,
    duration_s: 20,
    repeat: 0,
    warm_up_s: 3,
    capture_every_ms: 0,
    sample_stride: 30,
    dash_frame_rate: null,
    restore: "off",
    upscale: "off",
    reprojection: false,
    overscan: "auto",
    depth: true,
    surround: true,
    prediction: "off",
    dash_representation: null,
  });
});

test("models enhance what is stateless", () => {
  const runs = runsOf({ ...PLAN, restore: "anime4k-restore-m", upscale: "bicubic", repeats: 1 });
  expect(new Set(runs.map(({ mode, restore, upscale }) => `${mode} ${restore} ${upscale}`))).toEqual(
    new Set(["stateless anime4k-restore-m bicubic", "dash-tuned off off"]),
  );
  expect(runs.map((run) => settingsFor(run).upscale)).toEqual(["bicubic", "bicubic", "bicubic", "off"]);
});

test("how movement is met is the plan's for every run; plans of before had the page's own overscan, depth and surround", () => {
  const motion = { reprojection: true, prediction: "linear", overscan: 0.1, depth: false, surround: false } as const;
  for (const run of runsOf({ ...PLAN, ...motion })) {
    expect(run).toMatchObject(motion);
    expect(settingsFor(run)).toMatchObject(motion);
  }
  const { overscan: _, depth: __, surround: ___, ...before } = PLAN;
  expect(readPlan(before)).toMatchObject({ overscan: "auto", depth: true, surround: true });
});

const PARTS = [
  { trace_s: 60, movement_s: 3 },
  { trace_s: 5, movement_s: 40 },
];

test("every part is played by all that is compared, from where it begins", () => {
  const runs = runsOf({ ...PLAN, segments: PARTS, dash_frame_rate: 60 });
  expect(runs).toHaveLength(2 * 2 * 4);
  const begins = runs.map(({ segment, network, movement_offset_s }) => [segment, network.offset_s, movement_offset_s]);
  expect(begins.slice(0, 8)).toEqual([...Array(4).fill([0, 60, 3]), ...Array(4).fill([1, 5, 40])]);
  expect(new Set(runs.map(({ dash_frame_rate }) => dash_frame_rate))).toEqual(new Set([60]));
  expect(runsOf({ ...PLAN, segments: PARTS, network: UNSHAPED })[4]?.network).toEqual(UNSHAPED);
});

test("the order follows from the seed, compares what is close in time, and leaves repeats outermost", () => {
  const plan = { ...PLAN, segments: PARTS, shuffled: true };
  const runs = runsOf(plan);
  expect(runsOf(plan)).toEqual(runs);
  const labels = (seed: number) => runsOf({ ...plan, seed }).map((run) => conditionLabel(run));
  expect(new Set([1, 2, 3, 4].map((seed) => labels(seed).join())).size).toBeGreaterThan(1);
  expect(runs.map(({ repeat }) => repeat)).toEqual([...Array(8).fill(0), ...Array(8).fill(1)]);
  for (let block = 0; block < 16; block += 4) {
    const own = runs.slice(block, block + 4);
    expect(new Set(own.map(({ segment }) => segment)).size).toBe(1);
    expect(new Set(own.map((run) => conditionLabel(run))).size).toBe(4);
  }
});

test("plans of before have one part and their own order", () => {
  const { segments: _, dash_frame_rate: __, restore: _r, upscale: _u, seed: ___, shuffled: ____, ...before } = PLAN;
  expect(readPlan(before)).toEqual(PLAN);
});

const FAST = { down_kbps: 100_000, up_kbps: 50_000 };

test("a constant link has no delay, jitter or loss unless they are given", () => {
  const link = { ...FAST, delay_ms: 0, jitter_ms: 0, loss_pct: 0 };
  expect(constantLink(FAST)).toEqual({ link, trace: null, rtt_ms: null });
  expect(constantLink({ ...FAST, delay_ms: 10 }).link).toEqual({ ...link, delay_ms: 10 });
});

test.each(labels.map(({ label, ...network }) => [label, network] as const))(
  "a network is called %s",
  (label, network) => {
    expect(networkLabel(network)).toBe(label);
  },
);

test.each([PLAN, { ...PLAN, network: UNSHAPED }, { ...PLAN, network: constantLink(FAST) }])(
  "a plan is read as it was stored",
  (plan) => {
    expect(readPlan(JSON.parse(JSON.stringify(plan)))).toEqual(plan);
  },
);

test.each([null, {}, { seed: 1 }, { ...PLAN, modes: ["vr"] }, { ...PLAN, repeats: 1e9 }])("%j is no plan", (stored) => {
  expect(readPlan(stored)).toBeNull();
});

test("what is missing are the runs that are not complete, in the plan's order", () => {
  const rows = runsOf(PLAN).map((run, i) => {
    const configuration = { ...run, width: 640, height: 360, seed: 1 };
    return { configuration, status: i === 2 ? "failed" : "complete" } as RunRow;
  });
  const [first, second, failed, , , , , last] = runsOf(PLAN);
  expect(missingRuns(PLAN, [])).toEqual(runsOf(PLAN));
  expect(missingRuns(PLAN, rows.slice(2, -1))).toEqual([first, second, failed, last]);
  expect(missingRuns(PLAN, [...rows, { ...rows[2], status: "complete" } as RunRow])).toEqual([]);
});

test.each(runsOf({ ...PLAN, modes: MODES }).map((run) => [conditionLabel(run), run] as const))(
  "%s has settings that exist",
  (_, run) => {
    const settings = settingsFor(run);
    expect(validSettings({ ...DEFAULT_SETTINGS, ...settings })).toMatchObject(settings);
  },
);

test("estimates from what runs were seen to take", () => {
  expect(timeFor(PLAN, 8)).toBe(8 * 28_000);
  expect(timeFor(PLAN, 2, 1000)).toBe(2 * 24_000);
});

test("a fixed profile has the ladder's name", () => {
  expect(conditionLabel({ mode: "stateless", profile: 1 }, [{ name: "High" }, { name: "Medium" }])).toBe(
    "Fixed: Medium",
  );
});

test("local runs download the scene, and nothing else is asked of the server", () => {
  const runs = runsOf({ ...PLAN, modes: ["local-compressed"], repeats: 1 });
  expect(runs.map(({ mode }) => isLocal(mode))).toEqual([true]);
  expect(runs.map((run) => settingsFor(run).mode)).toEqual(["stateless"]);
  expect(runs.map((run) => [conditionLabel(run), run.sample_stride])).toEqual([["Local, compressed", 0]]);
});

test("earlier runs that downloaded a plain PLY have a name, and are planned no more", () => {
  expect(conditionLabel({ mode: "local-ply", profile: "budget" })).toBe("Local, PLY");
  expect(readPlan({ ...PLAN, modes: ["local-ply"] })).toBeNull();
});
