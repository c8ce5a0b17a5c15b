import { expect, test } from "vitest";
import { PAPER_LADDER } from "../abr/ladder";
import { DEFAULT_SETTINGS, SIDE_MODES } from "./settings";
import { anyPerView, anyStreamed, modeOf, settingsAt, settingsShown } from "./sides";

test("each choice of a side is a mode, with the stream that it names", () => {
  const { mode } = DEFAULT_SETTINGS;
  expect(SIDE_MODES.map((choice) => ({ ...modeOf(choice) }))).toEqual([
    { mode },
    { mode: "video" },
    { mode: "dash", dashPreset: "typical" },
    { mode: "dash", dashPreset: "tuned" },
    { mode: "dash", dashPreset: "edge" },
    { mode: "dash", dashPreset: "custom" },
    { mode: "webrtc" },
    { mode: "local" },
  ]);
});

test("side by side each has its own, and all else in common; in the other modes there is one picture", () => {
  const settings = { ...DEFAULT_SETTINGS, left: "dash-edge", right: "video", turnSpeed: 90 } as const;
  expect(settingsShown(settings)).toEqual([settings]);
  const compared = { ...settings, mode: "side-by-side" } as const;
  expect(settingsAt("left", compared)).toMatchObject({ mode: "dash", dashPreset: "edge", turnSpeed: 90 });
  expect(settingsAt("right", compared)).toMatchObject({ mode: "video", dashPreset: "tuned" });
  expect([anyPerView(compared), anyStreamed(compared)]).toEqual([true, true]);
  expect([anyPerView(settings), anyStreamed(settings)]).toEqual([true, false]);
});

test("a lock gives both sides one rung of the ladder, or one bit rate, and nothing adapts", () => {
  const compared = { ...DEFAULT_SETTINGS, mode: "side-by-side", left: "video", right: "dash-edge" } as const;
  const both = (lock: Partial<typeof DEFAULT_SETTINGS>) =>
    (["left", "right"] as const).map((place) => settingsAt(place, { ...compared, ...lock }, PAPER_LADDER));
  for (const side of both({ lock: "resolution", lockRung: 2 })) {
    expect(side).toMatchObject({ controller: "fixed", profile: 2, refine: false, dashRepresentation: { rung: 2 } });
    expect(side.bitrateKbps).toBeUndefined();
  }
  for (const side of both({ lock: "resolution", lockRung: 9 })) expect(side.profile).toBe(3); // a shorter ladder's last
  for (const [lockKbps, profile, rung] of [
    [10_000, 1, 0],
    [3500, 2, 0],
    [1000, 3, 2],
    [100, 3, 3],
  ] as const) {
    for (const side of both({ lock: "bitrate", lockKbps })) {
      const dashRepresentation = { rung, bitrate_kbps: lockKbps };
      expect(side).toMatchObject({ controller: "fixed", profile, dashRepresentation, bitrateKbps: lockKbps });
    }
  }
  expect(both({})[0]).toMatchObject({ controller: "budget", dashRepresentation: null });
  expect(settingsAt("left", { ...compared, mode: "video", lock: "bitrate" }, PAPER_LADDER).bitrateKbps).toBeUndefined();
});
