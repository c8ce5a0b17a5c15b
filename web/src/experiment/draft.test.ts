import { expect, test } from "vitest";
import { type Draft, parseDraft, toggled } from "./draft";
import { experimentPlan } from "./fake-plan";
import { constantLink, type ExperimentPlan, type Network } from "./plan";

const DRAFT: Draft = {
  name: " bus ",
  movement: "stroll",
  trace: "4g-bus",
  rtt: "100",
  modes: ["stateless"],
  profiles: ["latency"],
  frameRate: null,
  restore: "off",
  upscale: "off",
  reprojection: false,
  prediction: "off",
  overscan: "auto",
  depth: true,
  surround: true,
  segments: "1",
  repeats: "3",
  duration: "20",
  seed: "1",
  stride: "30",
  locked: true,
  exportAtEnd: false,
};
const PRESENT = constantLink({ down_kbps: 20_000, up_kbps: 5000, delay_ms: 10 });
const parsed = (more: Partial<Draft> = {}, present: Network | string = PRESENT) =>
  parseDraft({ ...DRAFT, ...more }, "courtyard", present, { movement: 60_000, traces: { "4g-bus": 180_000 } });

test("a draft becomes a plan", () => {
  expect(parsed()).toEqual({
    plan: experimentPlan({
      name: "bus",
      network: { link: null, trace: "4g-bus", rtt_ms: 100 },
      repeats: 3,
      duration_s: 20,
      warm_up_s: 3,
      shuffled: true,
      sample_stride: 30,
    }),
  });
});

test.each([
  ["without one, the trace keeps its own", { rtt: " " }, { link: null, trace: "4g-bus", rtt_ms: null }],
  ["none is even", { rtt: "0" }, { link: null, trace: "4g-bus", rtt_ms: 0 }],
  ["the link as it is has no other", { trace: null, rtt: "garbage" }, PRESENT],
])("round trip: %s", (_, more, network) => {
  expect(parsed(more)).toMatchObject({ plan: { network } });
});

test("a link that nobody knows is refused, unless a trace is to be played", () => {
  expect(parsed({ trace: null }, "The shaper is away.")).toEqual({ problems: ["The shaper is away."] });
  expect(parsed({}, "The shaper is away.")).toHaveProperty("plan");
});

test("a comma is a decimal point, and DASH needs no controller", () => {
  expect(parsed({ duration: "2,5", modes: ["dash-tuned"], profiles: [] })).toMatchObject({ plan: { duration_s: 2.5 } });
});

test("frames are sampled in the mode that asks for each", () => {
  expect(parsed({ modes: ["dash-tuned"], stride: "no number" })).toMatchObject({ plan: { sample_stride: 0 } });
});

test("different parts are taken of trace and movement, by the seed", () => {
  const parts = (more: Partial<Draft>) =>
    (parsed({ segments: "3", ...more }) as { plan: ExperimentPlan }).plan.segments;
  expect(parts({})).toHaveLength(3);
  expect(parts({})).toEqual(parts({}));
  expect(parts({ seed: "2" })).not.toEqual(parts({}));
  expect(parts({ trace: null }).map(({ trace_s }) => trace_s)).toEqual([0, 0, 0]);
});

test.each<[Partial<Draft>, string]>([
  [{ segments: "10" }, "The trace has room for 9 parts of 20 s, not for 10."],
  [{ segments: "0" }, "“Vary the movement” must be a whole number from 1 to 100."],
  [{ seed: "-1" }, "“Seed” must be a whole number from 0 to 4,294,967,295."],
  [{ stride: "0.5" }, "“Save every n-th frame” must be a whole number from 0 to 100,000."],
  [{ name: "  " }, "The experiment needs a name."],
  [{ name: "x".repeat(101) }, "The name must not be longer than 100 characters."],
  [{ movement: null }, "Choose a movement."],
  [{ rtt: "-1" }, "“Round trip” must be a number from 0 to 120,000 ms."],
  [{ rtt: "NaN" }, "“Round trip” must be a number from 0 to 120,000 ms."],
  [{ modes: [] }, "Choose a mode."],
  [{ profiles: [] }, "Choose a controller."],
  [{ repeats: "1.5" }, "“Runs of each” must be a whole number from 1 to 100."],
  [{ repeats: "1e9" }, "“Runs of each” must be a whole number from 1 to 100."],
  [{ duration: "" }, "“Each run lasts” must be a number from 1 to 7,200 s."],
  [{ duration: "Infinity" }, "“Each run lasts” must be a number from 1 to 7,200 s."],
])("%j is refused in one sentence", (more, sentence) => {
  expect(parsed(more)).toEqual({ problems: [sentence] });
});

test("what is chosen keeps the order of the list", () => {
  expect(toggled(["b"], "a", ["a", "b", "c"])).toEqual(["a", "b"]);
  expect(toggled(["a", "b"], "a", ["a", "b", "c"])).toEqual(["b"]);
});
