import { expect, test } from "vitest";
import { DEFAULT_SETTINGS, validSettings } from "../state/settings";
import { conditionOf, type ExperimentPlan, runsOf, settingsFor, timeFor } from "./plan";

const PLAN: ExperimentPlan = {
  name: "bus",
  scene: "courtyard",
  movement: "stroll",
  network: { trace: "4g-bus", rtt_ms: 100 },
  modes: ["stateless", "dash-tuned"],
  profiles: ["latency", "budget", 1],
  repeats: 2,
  duration_s: 20,
  warm_up_s: 3,
};

test("repeats all of them, not each of them, and multiplies only the stateless mode by the controllers", () => {
  const runs = runsOf(PLAN).map((run) => [run.repeat, conditionOf(run)]);
  const once = ["Latency", "Budget", "Fixed: profile 1", "DASH, tuned"];
  expect(runs).toEqual([...once.map((name) => [0, name]), ...once.map((name) => [1, name])]);
});

test("a run says all that must be known to make it again", () => {
  expect(runsOf(PLAN)[0]).toEqual({
    scene: "courtyard",
    movement: "stroll",
    network: { name: "4g-bus", rtt_ms: 100 },
    mode: "stateless",
    profile: "latency",
    duration_s: 20,
    repeat: 0,
    warm_up_s: 3,
    capture_every_ms: 0,
  });
});

test("the link as it is has no round trip of its own", () => {
  const [run] = runsOf({ ...PLAN, network: { trace: null, rtt_ms: 100 } });
  expect(run?.network).toEqual({ name: "unshaped", rtt_ms: null });
});

test.each(runsOf(PLAN).map((run) => [conditionOf(run), run] as const))("%s has settings that exist", (_, run) => {
  const settings = settingsFor(run);
  expect(validSettings({ ...DEFAULT_SETTINGS, ...settings })).toMatchObject(settings);
});

test("estimates from what runs were seen to take", () => {
  expect(timeFor(PLAN, 8)).toBe(8 * 28_000);
  expect(timeFor(PLAN, 2, 1000)).toBe(2 * 24_000);
});

test("a fixed profile has the ladder's name", () => {
  expect(conditionOf({ mode: "stateless", profile: 1 }, [{ name: "High" }, { name: "Medium" }])).toBe("Fixed: Medium");
});
