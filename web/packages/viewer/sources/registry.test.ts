import { expect, test } from "vitest";
import { SIDE_MODES } from "#client/wire/run";
import { SOURCES, VARIANTS, variantOf } from "./registry";

test("each choice of a side is a mode, with the stream that it names", () => {
  expect(VARIANTS.map(({ name }) => name)).toEqual([...SIDE_MODES]);
  expect(SIDE_MODES.map((name) => variantOf(name).settings)).toEqual([
    { mode: "stateless" },
    { mode: "video" },
    { mode: "dash", dashPreset: "typical" },
    { mode: "dash", dashPreset: "tuned" },
    { mode: "dash", dashPreset: "edge" },
    { mode: "dash", dashPreset: "custom" },
    { mode: "webrtc" },
    { mode: "local" },
  ]);
});

test("what reopens a mode is one of its settings", () => {
  for (const { settings, reopens } of Object.values(SOURCES)) {
    expect(reopens.filter((name) => !settings.includes(name))).toEqual([]);
  }
});
