import { expect, test } from "vitest";
import { type DashSettings, FRAME_RATES, PRESETS, planFor, tuned } from "./presets";

const DEFAULT: DashSettings = {
  dashPreset: "tuned",
  dashFrameRate: null,
  dashRepresentation: null,
  dashTransport: "tcp",
  dashCustom: tuned(30),
};

test.each(FRAME_RATES)(
  "at %i frames/s every preset has chunks that fit its segments, and as long as ever",
  (dashFrameRate) => {
    for (const dashPreset of PRESETS.filter((preset) => preset !== "custom")) {
      const { setup } = planFor({ ...DEFAULT, dashPreset, dashFrameRate });
      expect(setup.frame_rate).toBe(dashFrameRate);
      const chunk = dashPreset === "typical" ? dashFrameRate / 2 : 1;
      expect(setup.frames_per_chunk).toBe(chunk);
    }
  },
);

test("a person's own setup is taken as it is", () => {
  const { dashCustom } = DEFAULT;
  const plan = planFor({
    ...DEFAULT,
    dashPreset: "custom",
    dashFrameRate: 60,
    dashCustom: { ...dashCustom, frame_rate: 25 },
  });
  expect(plan).toEqual({
    setup: { ...dashCustom, frame_rate: 25 },
    player: "dash.js",
    adaptive: false,
    representation: null,
    transport: "tcp",
  });
});

test("from preset to preset the latency is lower", () => {
  const targets = (["typical", "tuned", "edge"] as const).map(
    (dashPreset) => planFor({ ...DEFAULT, dashPreset }).setup.target_latency_ms,
  );
  expect(targets).toEqual(targets.toSorted((a, b) => b - a));
});
