import { describe, expect, test } from "vitest";
import {
  ahead,
  approach,
  between,
  fromScene,
  isCut,
  levelFor,
  MAX_ELEVATION,
  move,
  orbit,
  orientation,
  type ScenePose,
  seenFrom,
  startCamera,
  toScene,
  turn,
} from "./camera";
import { type Quaternion, rotate, subtract, type Vector3 } from "./vector";

const LEVEL: Quaternion = [0, 0, 0, 1];
const AT_ORIGIN = { position: [0, 0, 0], azimuth: 0, elevation: 0 } as const;

function expectClose(actual: readonly number[], expected: readonly number[]): void {
  expect(actual).toHaveLength(expected.length);
  for (const [i, value] of expected.entries()) expect(actual[i]).toBeCloseTo(value, 5);
}

/** Direction of one of the camera's axes in the scene. */
const axis = (quaternion: readonly number[], direction: Vector3) =>
  rotate(quaternion as unknown as Quaternion, direction);
const FORWARD: Vector3 = [0, 0, 1];
const DOWN: Vector3 = [0, 1, 0];

describe("OpenCV's axes: x right, y down, z forward", () => {
  test.each([
    [0, 0, [0, 0, 1]],
    [90, 0, [1, 0, 0]],
    [-90, 0, [-1, 0, 0]],
    [180, 0, [0, 0, -1]],
    [0, 45, [0, -Math.SQRT1_2, Math.SQRT1_2]],
    [0, -45, [0, Math.SQRT1_2, Math.SQRT1_2]],
    [90, 30, [Math.cos(Math.PI / 6), -0.5, 0]],
  ])("azimuth %i and elevation %i look along %j", (azimuth, elevation, expected) => {
    expectClose(rotate(orientation(azimuth, elevation), FORWARD), expected);
  });

  test("the horizon stays level: the camera's x axis never leaves the floor's plane", () => {
    for (const azimuth of [0, 37, 120, -170]) {
      for (const elevation of [-80, 0, 15, 80]) {
        expect(rotate(orientation(azimuth, elevation), [1, 0, 0])[1]).toBeCloseTo(0, 9);
      }
    }
  });
});

describe("a scene's own frame", () => {
  test.each<[string, Vector3]>([
    ["level", [0, -1, 0]],
    ["z up", [0, 0, 1]],
    ["a tilted table", [0.1, -0.9, -0.4]],
  ])("%s: taking over from a pose keeps the view", (_, up) => {
    const camera = { position: [1, -2, 3], azimuth: -130, elevation: 25 } as const;
    const taken = fromScene(toScene(camera, levelFor(up)), levelFor(up));
    expectClose(taken.position, camera.position);
    expect(taken.azimuth).toBeCloseTo(camera.azimuth, 3);
    expect(taken.elevation).toBeCloseTo(camera.elevation, 3);
  });

  test("taking over from a pose that leans to the side stands upright", () => {
    const leaning = { position: [0, 0, 0], quaternion: [0, 0, Math.SQRT1_2, Math.SQRT1_2] } as const;
    const { azimuth, elevation } = fromScene(
      { position: [...leaning.position], quaternion: [...leaning.quaternion] },
      LEVEL,
    );
    expect([azimuth, elevation + 0]).toEqual([0, 0]);
  });

  test("with -y up the levelled frame is the scene's own", () => {
    expect(levelFor([0, -1, 0])).toEqual(LEVEL);
    const pose = toScene({ position: [1, 2, 3], azimuth: 0, elevation: 0 }, levelFor([0, -1, 0]));
    expect(pose).toEqual({ position: [1, 2, 3], quaternion: [0, 0, 0, 1] });
  });

  test.each<[string, Vector3]>([
    ["y up", [0, 1, 0]],
    ["z up", [0, 0, 1]],
    ["a tilted table", [0.1, -0.9, -0.4]],
    ["not of length one", [0, 0, -7]],
  ])("%s: up is up in the picture, and walking stays level", (_, up) => {
    const level = levelFor(up);
    const length = Math.hypot(...up);
    const standing = toScene(AT_ORIGIN, level);
    expectClose(
      axis(standing.quaternion, DOWN),
      up.map((value) => -value / length),
    );
    const walked = toScene(move({ ...AT_ORIGIN, azimuth: 33 }, 2, 1, 0), level);
    const rise = walked.position.reduce((sum, value, i) => sum + value * (up[i] ?? 0), 0);
    expect(rise).toBeCloseTo(0, 5);
    const risen = toScene(move(AT_ORIGIN, 0, 0, 3), level);
    expectClose(
      risen.position,
      up.map((value) => (3 * value) / length),
    );
  });

  test.each<[string, Vector3]>([
    ["-y up", [0, -1, 0]],
    ["z up", [0, 0, 1]],
    ["tilted", [0.3, -0.8, 0.2]],
  ])("the start camera stands where the scene says and sees what it says (%s)", (_, up) => {
    const camera = {
      position: [1, -2, 3] as [number, number, number],
      look_at: [4, -1, 5] as [number, number, number],
    };
    const pose = toScene(startCamera({ up: [...up], camera }), levelFor(up));
    expectClose(pose.position, camera.position);
    const direction = subtract(camera.look_at, camera.position);
    const length = Math.hypot(...direction);
    expectClose(
      axis(pose.quaternion, FORWARD),
      direction.map((value) => value / length),
    );
  });

  test("without a start camera one stands at the origin", () => {
    expect(startCamera({ up: [0, -1, 0], camera: null })).toEqual(AT_ORIGIN);
  });
});

test("a quaternion that is sent has length one", () => {
  const { quaternion } = toScene({ position: [0, 0, 0], azimuth: 123.4, elevation: -56.7 }, levelFor([1, 2, 3]));
  expect(Math.hypot(...quaternion)).toBeCloseTo(1, 5);
});

describe("turning", () => {
  test("nobody looks further than straight up or down", () => {
    expect(turn(AT_ORIGIN, 0, 500).elevation).toBe(MAX_ELEVATION);
    expect(turn(AT_ORIGIN, 0, -500).elevation).toBe(-MAX_ELEVATION);
  });

  test("the azimuth goes around and stays small", () => {
    let camera: ReturnType<typeof turn> = AT_ORIGIN;
    for (let i = 0; i < 1000; i++) camera = turn(camera, 50, 0);
    expect(Math.abs(camera.azimuth)).toBeLessThanOrEqual(180);
    expectClose(rotate(orientation(camera.azimuth, 0), FORWARD), rotate(orientation(50_000 % 360, 0), FORWARD));
  });
});

describe("walking is relative to the azimuth and never to the elevation", () => {
  test.each([
    [0, 1, 0, [0, 0, 1]],
    [90, 1, 0, [1, 0, 0]],
    [90, 0, 1, [0, 0, -1]],
    [0, 0, 1, [1, 0, 0]],
    [180, -1, 0, [0, 0, 1]],
  ])("facing %i°, forward %i and right %i goes to %j", (azimuth, forward, right, expected) => {
    expectClose(move({ position: [0, 0, 0], azimuth, elevation: 60 }, forward, right, 0).position, expected);
  });

  test("up is against y", () => {
    expect(move(AT_ORIGIN, 0, 0, 2).position[1]).toBe(-2);
  });
});

describe("what is looked at", () => {
  const camera = { position: [1, -2, 3], azimuth: 30, elevation: -20 } as const;

  test.each([
    ["straight ahead", ahead(camera, 4)],
    ["at the picture's edge", [3, -1, 7] as Vector3],
  ])("stays where it is in the picture while the camera orbits it: %s", (_, pivot) => {
    for (const [right, up] of [
      [40, 10],
      [-170, -60],
      [0, 500],
    ] as const) {
      expectClose(seenFrom(orbit(camera, pivot, right, up), pivot), seenFrom(camera, pivot));
    }
  });

  test("orbiting to the right shows its left side", () => {
    expectClose(orbit(AT_ORIGIN, [0, 0, 4], 90, 0).position, [-4, 0, 4]);
  });

  test("is half as far away and in the middle once it is approached", () => {
    const point: Vector3 = [4, -3, 9];
    const [x, y, z] = seenFrom(approach(camera, point), point);
    expectClose([x, y, z], [0, 0, Math.hypot(3, 1, 6) / 2]);
  });
});

test("halfway between two cameras goes the shorter way around", () => {
  const from = { position: [0, 0, 0], azimuth: 170, elevation: 0 } as const;
  const to = { position: [2, 0, 4], azimuth: -170, elevation: 20 } as const;
  const { position, azimuth, elevation } = between(from, to, 0.5);
  expectClose(position, [1, 0, 2]);
  expect([Math.abs(azimuth), elevation]).toEqual([180, 10]);
  expectClose(between(from, to, 1).position, to.position);
});

const pose = (x: number, azimuth: number): ScenePose => ({
  position: [x, 0, 0],
  quaternion: [...orientation(azimuth, 0)],
});

test.each([
  ["a quick turn", pose(0, 25), false],
  ["a turn that nobody makes", pose(0, 35), true],
  ["a stride", pose(0.5, 0), false],
  ["a jump", pose(1.6, 0), true],
])("%s", (_, after, cut) => {
  expect(isCut(pose(0, 0), after, 5)).toBe(cut);
});

test("a rotation's negative twin is no turn", () => {
  expect(isCut(pose(0, 0), { position: [0, 0, 0], quaternion: [0, 0, 0, -1] }, 5)).toBe(false);
});
