import { expect, test } from "vitest";
import { DEFAULT_SETTINGS } from "#viewer/state/settings";
import { linkedPose, linkedSettings, viewHash } from "./link";
import { parseRoute } from "./route";

const POSE = { position: [1.25, -2, 1234.5678], quaternion: [0, 0.6, 0, 0.8] } as const;
const pose = () => ({ position: [...POSE.position], quaternion: [...POSE.quaternion] }) as never;
const asked = (hash: string) => {
  const route = parseRoute(hash);
  if (route.page !== "viewer") throw new Error(hash);
  return route;
};

test("a link leads back to the view, with what is not as usual", () => {
  const chosen = {
    mode: "side-by-side",
    right: "local",
    reprojection: false,
    overscan: 0.1,
    prediction: "off",
  } as const;
  const hash = viewHash("my scene", pose(), { ...DEFAULT_SETTINGS, ...chosen, hud: false });
  const route = asked(hash);
  expect([route.scene, route.unknown]).toEqual(["my scene", undefined]);
  expect(linkedSettings(route.asked)).toEqual(chosen);
  expect(linkedPose(route.asked)).toEqual({ position: [1.25, -2, 1234.57], quaternion: [0, 0.6, 0, 0.8] });
});

test("what is as usual is left out", () => {
  expect(viewHash("a", pose(), DEFAULT_SETTINGS)).toBe("#/scene/a?at=1.25,-2,1234.57,0,0.6,0,0.8&mode=stateless");
});

test("settings that make no sense change nothing", () => {
  expect(linkedSettings({ mode: "telepathy", profile: "-1", refine: "maybe", depth: "off" })).toEqual({ depth: false });
});
