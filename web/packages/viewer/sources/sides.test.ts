import { expect, test } from "vitest";
import { PAPER_LADDER } from "#client/abr/ladder";
import { DEFAULT_SETTINGS } from "../state/settings";
import { applies, reopens, settingsAt, settingsShown, sideTitles } from "./sides";

test("side by side each has its own, and all else in common; in the other modes there is one picture", () => {
  const settings = { ...DEFAULT_SETTINGS, left: "dash-edge", right: "video", turnSpeed: 90 } as const;
  expect(settingsShown(settings)).toEqual([settings]);
  const compared = { ...settings, mode: "side-by-side" } as const;
  expect(settingsAt("left", compared)).toMatchObject({ mode: "dash", dashPreset: "edge", turnSpeed: 90 });
  expect(settingsAt("right", compared)).toMatchObject({ mode: "video", dashPreset: "tuned" });
  expect([sideTitles(settings), sideTitles(compared)]).toEqual([["Stateless"], ["DASH, edge", "Video"]]);
  const affected = (chosen: typeof DEFAULT_SETTINGS) =>
    (["controller", "depth", "dashPreset", "webrtcStream"] as const).filter((name) => applies(name, chosen));
  expect([affected(settings), affected(compared)]).toEqual([
    ["controller", "depth"],
    ["controller", "dashPreset"],
  ]);
});

test.each([
  ["stateless", { reprojection: false }, false],
  ["stateless", { mode: "video" }, true],
  ["dash", { reprojection: false }, true],
  ["dash", { dashCustom: { ...DEFAULT_SETTINGS.dashCustom, target_latency_ms: 300 } }, true],
  ["dash", { webrtcStream: "vp8-60" }, false],
  ["webrtc", { webrtcStream: "vp8-60" }, true],
  ["side-by-side", { right: "dash-edge" }, true],
  ["side-by-side", { dashPreset: "edge" }, false],
] as const)("in the mode %s, %o opens something anew: %s", (mode, changed, anew) => {
  const before = { ...DEFAULT_SETTINGS, mode };
  expect(reopens(before, { ...before, ...changed })).toBe(anew);
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
  expect(both({})[0]).toMatchObject({ controller: "seen", dashRepresentation: null });
  expect(settingsAt("left", { ...compared, mode: "video", lock: "bitrate" }, PAPER_LADDER).bitrateKbps).toBeUndefined();
});
