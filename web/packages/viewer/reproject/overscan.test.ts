import { beforeEach, expect, test } from "vitest";
import { orientation } from "../view/camera";
import { defaultIntrinsics } from "../view/intrinsics";
import { AutoOverscan, MAX_OVERSCAN, neededMargin } from "./overscan";
import type { View } from "./view";

const STAGE = { width: 1280, height: 720 };
const FRAME = 1000 / 60;

function looking(azimuth: number, elevation = 0, x = 0): View {
  return {
    position: [x, 0, 0],
    quaternion: orientation(azimuth, elevation),
    ...defaultIntrinsics(STAGE),
    ...STAGE,
  };
}

let subject: AutoOverscan;
let now: number;
let azimuth: number;

beforeEach(() => {
  subject = new AutoOverscan();
  now = 0;
  azimuth = 0;
});

/** Turns for this many milliseconds; the shown picture was rendered for the camera's pose `age` earlier. */
function turn(degreesPerSecond: number, duration: number, age: number): number {
  for (const until = now + duration; now < until; ) {
    now += FRAME;
    azimuth += (degreesPerSecond * FRAME) / 1000;
    subject.observe(looking(azimuth - (degreesPerSecond * age) / 1000), looking(azimuth), now);
  }
  return subject.at(now);
}

test("a view that is the frame's own needs no margin, one to the side as much as it reaches beyond", () => {
  expect(neededMargin(looking(20, 5), looking(20, 5))).toBeCloseTo(0, 9);
  const { fx } = defaultIntrinsics(STAGE);
  const edge = Math.atan(STAGE.width / 2 / fx) + (6 * Math.PI) / 180;
  expect(neededMargin(looking(0), looking(6))).toBeCloseTo((fx * Math.tan(edge)) / STAGE.width - 0.5, 6);
  expect(neededMargin(looking(0), looking(-6))).toBeCloseTo(neededMargin(looking(0), looking(6)), 9);
  expect(neededMargin(looking(0), looking(0, 6))).toBeGreaterThan(0.1);
  expect(neededMargin(looking(0), looking(180))).toBe(Number.POSITIVE_INFINITY);
});

test("a step aside needs a margin where the scene is near, and none where it is far", () => {
  expect(neededMargin(looking(0), looking(0, 0, 0.5), 5)).toBeGreaterThan(0.04);
  expect(neededMargin(looking(0), looking(0, 0, 0.5))).toBeCloseTo(0, 9);
});

test("a steady turn gets what it needs, and no more than a step beyond", () => {
  const overscan = turn(40, 3000, 100);
  const needed = neededMargin(looking(0), looking(4));
  expect(overscan).toBeGreaterThanOrEqual(needed);
  expect(overscan).toBeLessThan(needed + 0.03);
});

test("where frames are rendered for the views that they are shown at, nothing is asked for", () => {
  expect(turn(40, 3000, 0)).toBe(0);
});

test("a faster turn gets more at once, before its pictures have come", () => {
  const before = turn(30, 2000, 100);
  azimuth += 0.2; // the shown surface is as near as before
  for (let i = 0; i < 5; i++) {
    now += FRAME;
    azimuth += 1.2;
    subject.observe(looking(azimuth - 3), looking(azimuth), now);
  }
  expect(subject.at(now)).toBeGreaterThan(1.5 * before);
});

test("a slower one gets less", () => {
  const before = turn(40, 2000, 100);
  expect(turn(10, 200, 100)).toBeLessThan(0.6 * before);
});

test("at rest it is 0 in whatever direction the camera looks", () => {
  turn(40, 2000, 100);
  const old = looking(azimuth - 4);
  // In such an orientation, rounding keeps the turn from it to itself above zero.
  const quaternion = [-0.04679130049878238, 0.07294714730508184, 0.03249318085445294, 0.9957075278894113] as const;
  const view = { ...looking(azimuth), quaternion };
  for (const until = now + 300; now < until; now += FRAME) subject.observe(old, view, now);
  expect(subject.at(now)).toBe(0);
});

test("however fast it turns, there is a limit", () => {
  expect(turn(300, 2000, 150)).toBe(MAX_OVERSCAN);
});

test("at rest it is 0; another turn gets a margin from earlier needs", () => {
  turn(40, 2000, 100);
  expect(turn(0, 300, 0)).toBe(0);
  expect(turn(40, 60, 0)).toBeGreaterThan(0.02);
});

test("a cut is no turn", () => {
  const before = turn(20, 2000, 100);
  azimuth += 170;
  now += FRAME;
  subject.observe(looking(azimuth - 170), looking(azimuth), now);
  expect(subject.at(now)).toBe(before);
});

test("a pause of the page is no fast turn", () => {
  const before = turn(20, 2000, 100);
  now += 5000;
  azimuth += 40;
  subject.observe(looking(azimuth - 2), looking(azimuth), now);
  expect(turn(20, 300, 100)).toBe(before);
});
