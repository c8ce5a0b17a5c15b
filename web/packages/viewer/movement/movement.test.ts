import { describe, expect, test } from "vitest";
import type { SceneInfo } from "#client/wire/render";
import golden from "../../../../tests/experiments/movement/golden.json";
import { angleBetween, type Quaternion } from "../view/vector";
import { MovementError, placeInScene, poseAt, type TimedPose, toLevelFrame } from "./movement";
import { MAX_BYTES, readMovement, readMovementFile, writeMovement } from "./movement-file";

const HEADER = "t_ms,x,y,z,qx,qy,qz,qw\n";
const POSE = "0,1,2,3,0,0,0,1\n";

type Place = Pick<SceneInfo, "camera" | "up">;
const MOVEMENTS: Readonly<Record<string, string>> = golden.movements;
const SCENES = golden.scenes as unknown as Readonly<Record<string, Place>>;
const PLACED = golden.placed.map(({ movement, scene, points }) => [movement, scene, points] as const);

function expectClose(actual: readonly number[], expected: readonly number[], digits = 9): void {
  expect(actual).toHaveLength(expected.length);
  for (const [i, value] of expected.entries()) expect(actual[i]).toBeCloseTo(value, digits);
}

function expectSameTurn(actual: Quaternion, expected: readonly number[], digits: number): void {
  expect(Math.hypot(...actual)).toBeCloseTo(1, 9);
  expect(angleBetween(actual, expected as unknown as Quaternion)).toBeCloseTo(0, digits);
}

describe("as `tigas` reads and places movements", () => {
  test.each(PLACED)("%s; %s", (movement, scene, expected) => {
    const points = placeInScene(readMovement(MOVEMENTS[movement] ?? ""), SCENES[scene] as Place);
    expect(points.map(({ t_ms }) => t_ms)).toEqual(expected.map(({ t_ms }) => t_ms));
    for (const [i, { position, quaternion }] of points.entries()) {
      expectClose(position, expected[i]?.position ?? []);
      expectSameTurn(quaternion, expected[i]?.quaternion ?? [], 6);
    }
  });

  test.each(Object.entries(golden.refused))("%s is no movement", (_, text) => {
    const read = () => readMovement(text, "walk.csv");
    expect(read).toThrow(MovementError);
    expect(read).toThrow(/^walk\.csv[^\n]+\.$/);
  });

  test.each(Object.entries(MOVEMENTS))("what is written is read back: %s", (_, text) => {
    const trace = readMovement(text);
    const written = writeMovement(trace);
    const again = readMovement(written);
    expect(writeMovement(again)).toBe(written);
    expect([again.anchor, again.unit, again.comments]).toEqual([trace.anchor, trace.unit, trace.comments]);
  });
});

describe("reading", () => {
  test("what the file says of itself", () => {
    const trace = readMovement(`# anchor: start\n# by: somebody: me\n# only words\n${HEADER}50,1,2,3,0,0,0,1\n`);
    expect(trace.anchor).toBe("start");
    expect([...trace.comments]).toEqual([["by", "somebody: me"]]);
  });

  test.each([
    ["a binary file", "PK\u0003\u0004\u0000\u0000", "is binary"],
    ["hexadecimal", `${HEADER}0,0x10,2,3,0,0,0,1\n`, "line 2: the row needs a number as x"],
    ["a truncated row after a remark", `# hello\n\n${HEADER}${POSE}16,1,2\n`, "line 5: the row needs a number as z"],
    ["another recorder's", `ViewIndex,FOV1\n0,1\n`, "tigas movement import"],
    ["an endless line", `${HEADER}${"0,".repeat(6000)}\n`, "line 2 is longer"],
    ["too many poses", HEADER + POSE.repeat(500_001), "more than 500000 rows"],
  ])("%s is no movement, and why", (_, text, sentence) => {
    expect(() => readMovement(text)).toThrow(sentence);
  });

  test("a file is not read when it is too large, or gone", async () => {
    const large = { name: "film.mkv", size: MAX_BYTES + 1 } as File;
    await expect(readMovementFile(large)).rejects.toThrow("film.mkv is larger than 64 MB");
    const gone = {
      name: "gone.csv",
      size: 1,
      arrayBuffer: () => Promise.reject(new DOMException("gone")),
    } as unknown as File;
    await expect(readMovementFile(gone)).rejects.toThrow("gone.csv cannot be read.");
    const latin = new File([new Uint8Array([0x23, 0xe9, 0x0a])], "latin.csv");
    await expect(readMovementFile(latin)).rejects.toThrow("latin.csv is binary");
    const scene = new File(["ply\n"], "garden.PLY");
    await expect(readMovementFile(scene)).rejects.toThrow("garden.PLY is a scene, not a movement: put it into");
    expect((await readMovementFile(new File([HEADER, POSE], "walk.csv"))).points).toHaveLength(1);
  });
});

describe("writing", () => {
  test.each(Object.keys(SCENES))("what was seen in a scene is read as the same poses: %s", (name) => {
    const scene = SCENES[name] as Place;
    const seen = [
      { t_ms: 0, position: [1, 2, 3], quaternion: [0, 0, 0, 1] },
      { t_ms: 16.667, position: [-1.25, 2, 1e-7], quaternion: [0.5, -0.5, 0.5, 0.5] },
    ] as const;
    const points = seen.map(({ t_ms, position, quaternion }) => ({
      t_ms,
      ...toLevelFrame({ position: [...position], quaternion: [...quaternion] }, scene),
    }));
    const comments = new Map([["scene", " my\nscene "]]);
    const trace = readMovement(writeMovement({ anchor: "scene", unit: "scene", comments, points, duration: 16.667 }));
    expect(trace.comments.get("scene")).toBe("my scene");
    for (const [i, point] of placeInScene(trace, scene).entries()) {
      expect(point.t_ms).toBe(seen[i]?.t_ms);
      expectClose(point.position, seen[i]?.position ?? [], 5);
      expectSameTurn(point.quaternion, seen[i]?.quaternion ?? [], 3);
    }
  });
});

const HALF = Math.SQRT1_2;
const at = (t_ms: number, x: number, quaternion: TimedPose["quaternion"] = [0, 0, 0, 1]): TimedPose => ({
  t_ms,
  position: [x, 0, 0],
  quaternion,
});

test.each([
  [-5, 1],
  [0, 1],
  [50, 2],
  [100, 3],
  [250, 4.5],
  [400, 6],
  [9999, 6],
])("at %d ms the position is %d", (t, x) => {
  expect(poseAt([at(0, 1), at(100, 3), at(400, 6)], t).position[0]).toBeCloseTo(x);
});

test("turns at an even pace", () => {
  const { quaternion } = poseAt([at(0, 0), at(100, 0, [0, HALF, 0, HALF])], 100 / 3);
  const degrees = (2 * Math.atan2(quaternion[1], quaternion[3]) * 180) / Math.PI;
  expect(degrees).toBeCloseTo(30);
});

test("takes the shorter way between a rotation and its negative twin", () => {
  const { quaternion } = poseAt([at(0, 0), at(100, 0, [0, -HALF, 0, -HALF])], 50);
  const degrees = (2 * Math.atan2(quaternion[1], quaternion[3]) * 180) / Math.PI;
  expect(degrees).toBeCloseTo(45);
});

test("rotations stay of length one, equal ones too, and points may share a time", () => {
  const points = [at(0, 0), at(0, 1), at(100, 1)];
  expect(Math.hypot(...poseAt(points, 50).quaternion)).toBeCloseTo(1);
  expect(poseAt(points, 0).position[0]).toBe(1);
});
