import { expect, test } from "vitest";
import { DEFAULT_SETTINGS } from "#viewer/state/settings";
import { type Draft, experimentFile, toggled } from "./file";

const DRAFT: Draft = {
  name: 'A "walk"',
  movement: "store/walk",
  trace: null,
  rtt: "80",
  modes: ["stateless", "dash-tuned"],
  controllers: ["latency", 0],
  reprojection: false,
  prediction: "off",
  segments: "1",
  repeats: "2",
  duration: "1.5",
  stride: "0",
};
const written = (draft: Partial<Draft> = {}, settings: object = {}) =>
  experimentFile(
    { ...DRAFT, ...draft },
    {
      scene: "hall",
      movement: "walk.csv",
      present: "20mbit",
      settings: { ...DEFAULT_SETTINGS, restore: "off", upscale: "off", ...settings },
      viewport: { width: 640, height: 360 },
    },
  );

test("the form is written as TOML", () => {
  expect(written()).toBe(`name = "A \\"walk\\""
scenes = ["hall"]
movements = ["walk.csv"]
networks = ["20mbit"]
modes = ["stateless","dash-tuned"]
controllers = ["latency",0]
reprojection = false
prediction = "off"
segments = 1
repeats = 2
duration_s = 1.5
viewport = "640x360"
seed = 1
sample_stride = 0
`);
});

test.each<[string, Partial<Draft>, object, string[]]>([
  ["a trace at its own round trip", { trace: "stairs", rtt: " " }, {}, ['networks = ["stairs"]']],
  ["a trace at another", { trace: "stairs" }, {}, ['networks = ["stairs"]', "rtts_ms = [80]"]],
  ["enhancement", {}, { upscale: "bicubic" }, ['upscale = "bicubic"']],
  [
    "reprojection",
    { reprojection: true },
    { overscan: 0.1 },
    ["reprojection = true", "overscan = 0.1", "depth = true"],
  ],
  ["what is no number, for the store to refuse", { repeats: "two" }, {}, ['repeats = "two"']],
])("%s", (_, draft, settings, lines) => {
  for (const line of lines) expect(written(draft, settings)).toContain(`${line}\n`);
});

test("a mode without controllers says nothing of them", () => {
  expect(written({ modes: ["webrtc"] }, { upscale: "bicubic" })).not.toMatch(/controllers|upscale|overscan|rtts_ms/);
});

test("a list keeps the order of all choices", () => {
  expect(toggled(["c"], "a", ["a", "b", "c"])).toEqual(["a", "c"]);
  expect(toggled(["a", "c"], "a", ["a", "b", "c"])).toEqual(["c"]);
});
