import { expect, test } from "vitest";
import { COURTYARD } from "#fakes/server";
import { DEFAULT_SETTINGS } from "#viewer/state/settings";
import { linkedPose, linkedSettings, linkNote, viewHash } from "./link";
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

test.each([
  [
    { mode: "video", restore: "anime4k-restore-m" },
    { mode: "video", restore: "anime4k-restore-m" },
  ],
  [{ right: "video" }, { mode: "side-by-side", right: "video" }],
  [
    { reprojection: "off", drag: "orbit" },
    { reprojection: false, drag: "orbit" },
  ],
  [{ mode: "telepathy", left: "magic", profile: "-1", refine: "maybe", depth: "off" }, { depth: false }],
])("a link with %o chooses %o", (named, chosen) => {
  expect(linkedSettings(named)).toEqual(chosen);
});

test.each([
  [
    { left: "local-ply" },
    /^The link sets left to “local-ply”, which is not a valid value; choose one of stateless, video, /,
  ],
  [
    { prediction: "magic" },
    /^The link sets prediction to “magic”, which is not a valid value; choose one of off, velocity, /,
  ],
  [{ upscale: "magic" }, /^The link sets upscale to “magic”, which is not a valid value; choose one of off, bicubic, /],
  [
    { reprojection: "maybe" },
    /^The link sets reprojection to “maybe”, which is not a valid value; choose one of on, off\.$/,
  ],
  [{ profile: "-2" }, /^The link sets profile to “-2”, which is not a valid value\.$/],
  [{ at: "here" }, /^The camera pose in the link is invalid/],
  [{ view: "constructor" }, /^This scene has no saved view named “constructor”\.$/],
])("a link with %o says what makes no sense in it", (named, sentence) => {
  expect(linkNote(named, [], COURTYARD)).toMatch(sentence);
});

test("what a link names and nobody knows is said", () => {
  const { asked: named, unknown } = asked("#/scene/courtyard?predicton=linear");
  expect(linkNote(named, unknown)).toMatch(/^Unknown setting in the link: “predicton”. Supported: at, view/);
  expect(linkNote({ mode: "video" })).toBeNull();
});
