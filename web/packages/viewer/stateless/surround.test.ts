import { beforeEach, expect, test } from "vitest";
import type { Rung } from "#client/wire/render";
import { SIDES, sideView } from "../reproject/side-pictures";
import type { View } from "../reproject/view";
import { orientation } from "../view/camera";
import type { Vector3 } from "../view/vector";
import { Surround, type Surroundings, type WantedSide } from "./surround";

const UP: Vector3 = [0, -1, 0];
const rung = (width: number, height: number, expected_kb: number): Rung => ({
  name: "",
  width,
  height,
  quality: 20,
  expected_kb,
});
const LADDER = [rung(1280, 720, 200), rung(640, 360, 20), rung(320, 180, 6), rung(256, 144, 2)];
const [AHEAD, RIGHT, LEFT, ABOVE, BELOW] = [0, 1, 3, 4, 5] as const;

let surround: Surround;
let there: Map<number, View>;
let now: number;

beforeEach(() => {
  surround = new Surround(10, UP);
  there = new Map();
  now = 0;
});

function next(changes: Partial<Surroundings> = {}, at: Vector3 = [0, 0, 0], azimuth = 0): WantedSide | null {
  const pose = { position: [...at] as [number, number, number], quaternion: [...orientation(azimuth, 0)] as const };
  return surround.next({
    now,
    pose: { ...pose, quaternion: [...pose.quaternion] },
    there,
    idle: true,
    throughput: 4e6,
    ladder: LADDER,
    ...changes,
  });
}

/** Requests and receives sides as soon as allowed, until all are complete; returns the sides. */
function all(at: Vector3 = [0, 0, 0], azimuth = 0): number[] {
  const sides: number[] = [];
  for (const limit = now + 5000; now < limit; now++) {
    const wanted = next({}, at, azimuth);
    if (wanted === null) continue;
    there.set(wanted.side, wanted.view);
    sides.push(wanted.side);
    surround.came(wanted.side, 2000, 5, 4e6);
  }
  return sides;
}

test("asks for every side once, first where the camera looks, last behind it", () => {
  const sides = all([0, 0, 0], 80);
  expect(sides.toSorted()).toEqual([...SIDES]);
  expect([sides[0], sides.at(-1)]).toEqual([RIGHT, LEFT]);
  expect(next({}, [1.9, 0, 0])).toBeNull();
});

test("asks again from where the camera has gone, once that is a fifth of the scene's distance away", () => {
  all();
  const again = next({}, [2.1, 0, 0]);
  expect(again).toMatchObject({ side: AHEAD, view: { position: [2.1, 0, 0] } });
});

test("of two sides to the left and the right, the one that was never seen goes first, then the one from farther away", () => {
  for (const side of SIDES) there.set(side, sideView(side, [0, 0, 0], UP));
  there.delete(LEFT);
  there.set(RIGHT, sideView(RIGHT, [0, 0, -4], UP));
  expect(next()?.side).toBe(LEFT);
  surround = new Surround(10, UP);
  there.set(LEFT, sideView(LEFT, [0, 0, -3], UP));
  expect(next()?.side).toBe(RIGHT);
});

/** Every side is available, but from so far away that it is requested again. */
function allFromAfar(): void {
  for (const side of SIDES) there.set(side, sideView(side, [0, 0, -4], UP));
}

test.each([
  { when: "a view is under way", idle: false, known: false },
  { when: "all of them were seen before", idle: true, known: true },
])("one side is under way at a time while $when", ({ idle, known }) => {
  if (known) allFromAfar();
  const first = next({ idle });
  expect(first).not.toBeNull();
  now += 60_000;
  expect(next({ idle })).toBeNull();
  surround.came(first?.side ?? 0, 2000, 5, 4e6);
  expect(next({ idle })).not.toBeNull();
});

test("where the view rests, sides that were never seen come two at a time and without a pause, and the view gets no sharper before", () => {
  const hurries = () => surround.hurries({ there, throughput: 0.1e6, ladder: LADDER });
  const slow = { throughput: 0.1e6 };
  let underWay = [next(slow), next(slow)];
  expect(next(slow)).toBeNull();
  for (let came = 0; came < SIDES.length; came++) {
    expect(hurries()).toBe(true);
    const [oldest, ...others] = underWay;
    if (!oldest) throw new Error("no side is under way");
    surround.came(oldest.side, 2000, 5, 0.1e6);
    there.set(oldest.side, oldest.view);
    underWay = [...others, next(slow)];
  }
  expect(new Set(there.keys())).toEqual(new Set(SIDES));
  expect([underWay, hurries()]).toEqual([[null, null], false]);
});

test.each([
  { why: "the link is too slow for any", throughput: 0.03e6, fails: false },
  { why: "the last one failed", throughput: 4e6, fails: true },
])("the view gets sharper without waiting for sides where $why", ({ throughput, fails }) => {
  const wanted = next({ throughput });
  if (fails) surround.failed(wanted?.side ?? 0);
  expect(surround.hurries({ there, throughput, ladder: LADDER })).toBe(false);
});

test.each([
  // 2000 bytes take 16 ms at 1 Mbit/s and 4 ms at 4 Mbit/s.
  { throughput: 1e6, server: 5, idle: false, pause: 320 },
  { throughput: 4e6, server: 3, idle: false, pause: 80 },
  { throughput: 4e6, server: 40, idle: false, pause: 800 },
  { throughput: 4e6, server: 30, idle: true, pause: 100 },
])("link and server keep nearly all of their time for the view: $throughput bit/s, $server ms, idle: $idle", (one) => {
  const { throughput, server, idle, pause } = one;
  allFromAfar();
  const first = next();
  now += 10;
  surround.came(first?.side ?? 0, 2000, server, throughput);
  now = pause - 1;
  expect(next({ idle })).toBeNull();
  now = pause + 1;
  expect(next({ idle })).not.toBeNull();
});

test("a side that fails is asked for again, but not at once", () => {
  const failed = next();
  surround.failed(failed?.side ?? 0);
  now += 400;
  expect(next()).toBeNull();
  now += 200;
  expect(next()?.side).toBe(failed?.side);
});

test("sides are as good as the link sends in a moment, and never large", () => {
  const profile = (throughput: number | null) => {
    surround = new Surround(10, UP);
    return next({ throughput })?.profile;
  };
  expect([null, 0.2e6, 1e6, 5e6, 100e6].map(profile)).toEqual([3, 3, 3, 2, 2]);
});

test("a side that would keep a slow link from the view waits until that rests", () => {
  // The smallest has 2 kB: 80 ms at 0.2 Mbit/s, 20 ms at 0.8 Mbit/s.
  expect(next({ throughput: 0.2e6, idle: false })).toBeNull();
  expect(next({ throughput: 0.03e6, idle: true })).toBeNull();
  expect(next({ throughput: 0.8e6, idle: false })).not.toBeNull();
});

test("without a ladder nothing is asked for", () => {
  expect(next({ ladder: [] })).toBeNull();
});

test("looking up shows the sky first", () => {
  const quaternion = [...orientation(0, 70)] as [number, number, number, number];
  const position: [number, number, number] = [0, 0, 0];
  expect(next({ pose: { position, quaternion } })?.side).toBe(ABOVE);
  surround = new Surround(10, UP);
  const down = [...orientation(0, -70)] as [number, number, number, number];
  expect(next({ pose: { position, quaternion: down } })?.side).toBe(BELOW);
});
