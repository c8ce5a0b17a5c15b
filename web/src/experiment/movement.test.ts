import { describe, expect, test } from "vitest";
import { levelFor } from "../camera/camera";
import { angleBetween, multiply, rotate } from "../camera/vector";
import type { SceneInfo } from "../wire";
import { levelled, MovementError, placed, readMovement, writeMovement } from "./movement";

const HEADER = "t_ms,x,y,z,qx,qy,qz,qw\n";
const HALF = Math.SQRT1_2;
type Place = Pick<SceneInfo, "camera" | "up">;

function expectClose(actual: readonly number[] | undefined, expected: readonly number[]): void {
  expect(actual).toHaveLength(expected.length);
  for (const [i, value] of expected.entries()) expect(actual?.[i]).toBeCloseTo(value, 6);
}

describe("reading", () => {
  test("poses, what the file says of itself, and stamps from zero", () => {
    const trace = readMovement(
      `# anchor: start\n# Made by: somebody: me\n# only words\n${HEADER}50,1,2,3,0,0,0,1\n1100.5,-4,5e-1,.6,0,1,0,0\n`,
    );
    expect(trace.anchor).toBe("start");
    expect(trace.metadata.get("made by")).toBe("somebody: me");
    expect(trace.duration).toBe(1050.5);
    expect(trace.points).toEqual([
      { t_ms: 0, position: [1, 2, 3], quaternion: [0, 0, 0, 1] },
      { t_ms: 1050.5, position: [-4, 0.5, 0.6], quaternion: [0, 1, 0, 0] },
    ]);
  });

  test("without an anchor it is where the scene is; columns may be more, and in any order", () => {
    const trace = readMovement("\uFEFFfov,qw,qz,qy,qx,z,y,x,t_ms\r\nwide,1,0,0,0,3,2,1,0\r\n\r\n");
    expect(trace.anchor).toBe("scene");
    expect(trace.points).toEqual([{ t_ms: 0, position: [1, 2, 3], quaternion: [0, 0, 0, 1] }]);
  });

  test("rotations are made of length one", () => {
    expect(readMovement(`${HEADER}0,0,0,0,0,0.02,0,-0.02\n`).points[0]?.quaternion).toEqual([
      0,
      expect.closeTo(HALF),
      0,
      expect.closeTo(-HALF),
    ]);
  });

  test.each([
    ["nothing", "", /columns.*t_ms/],
    ["a binary file", "PK\u0003\u0004\u0000\u0000", /columns/],
    ["another table", "time,x\n0,1\n", /there is no t_ms, y, z, qx/],
    ["a header alone", HEADER, /no poses/],
    ["an unknown anchor", `# anchor: moon\n${HEADER}0,1,2,3,0,0,0,1\n`, /anchor is “start” or “scene”/],
    ["a stamp twice", `${HEADER}0,1,2,3,0,0,0,1\n0,1,2,3,0,0,0,1\n`, /Row 2: t_ms must grow/],
    ["a falling stamp", `${HEADER}0,1,2,3,0,0,0,1\n9,1,2,3,0,0,0,1\n8,1,2,3,0,0,0,1\n`, /Row 3: t_ms must grow/],
    ["not a number", `${HEADER}0,1,2,nan,0,0,0,1\n`, /Row 1: a pose needs 8 numbers/],
    ["no number where one belongs", `${HEADER}0,1,2,,0,0,0,1\n`, /Row 1/],
    ["infinity", `${HEADER}0,1,2,Infinity,0,0,0,1\n`, /Row 1/],
    ["a number too large to be one", `${HEADER}0,1,2,1e999,0,0,0,1\n`, /Row 1/],
    ["hexadecimal", `${HEADER}0,0x10,2,3,0,0,0,1\n`, /Row 1/],
    ["a truncated row", `${HEADER}0,1,2,3,0,0,0,1\n16,1,2\n`, /Row 2/],
    ["a row too long", `${HEADER}0,1,2,3,0,0,0,1,9\n`, /Row 1/],
    ["no rotation", `${HEADER}0,1,2,3,0,0,0,0\n`, /quaternion is zero/],
    ["too many poses", HEADER + "0,1,2,3,0,0,0,1\n".repeat(500_001), /500000 poses at most/],
  ])("%s is no movement", (_, text, sentence) => {
    const read = () => readMovement(text);
    expect(read).toThrow(MovementError);
    expect(read).toThrow(sentence);
  });
});

describe("placing", () => {
  const text = (anchor: string) => `# anchor: ${anchor}\n${HEADER}0,0,0,0,0,0,0,1\n100,1,0,2,0,${HALF},0,${HALF}\n`;

  test("a movement of the scene stays where it is, in the scene's own frame", () => {
    const scene: Place = { up: [0, 0, 1], camera: { position: [5, 5, 5], look_at: [0, 0, 5] } };
    const [first, second] = placed(readMovement(text("scene")), scene);
    expectClose(first?.position, [0, 0, 0]);
    expectClose(second?.position, [...rotate(levelFor(scene.up), [1, 0, 2])]);
    expectClose(second?.quaternion, [...multiply(levelFor(scene.up), [0, HALF, 0, HALF])]);
  });

  test("a movement from the start begins at the start camera, turned towards where that looks, upright", () => {
    // Looks along x, and down.
    const scene: Place = { up: [0, -1, 0], camera: { position: [1, -2, 3], look_at: [5, -1, 3] } };
    const [first, second] = placed(readMovement(text("start")), scene);
    expectClose(first?.position, [1, -2, 3]);
    expectClose(first?.quaternion, [0, HALF, 0, HALF]);
    expectClose(second?.position, [3, -2, 2]);
    expect(angleBetween(second?.quaternion ?? [0, 0, 0, 1], [0, 1, 0, 0])).toBeCloseTo(0, 6);
  });

  test("without a start camera it begins at the origin, and its times stay", () => {
    const points = placed(readMovement(text("start")), { up: [0, -1, 0], camera: null });
    expect(points.map(({ t_ms }) => t_ms)).toEqual([0, 100]);
    expectClose(points[1]?.position, [1, 0, 2]);
  });
});

describe("writing", () => {
  test.each<[string, SceneInfo["up"]]>([
    ["level", [0, -1, 0]],
    ["z up", [0, 0, 1]],
    ["tilted", [0.1, -0.9, -0.4]],
  ])("what was seen in a scene (%s) is read as the same poses", (_, up) => {
    const seen = [
      { t_ms: 0, position: [1, 2, 3], quaternion: [0, 0, 0, 1] },
      { t_ms: 16.667, position: [-1.25, 2, 1e-7], quaternion: [0.5, -0.5, 0.5, 0.5] },
    ] as const;
    const points = seen.map(({ t_ms, position, quaternion }) => ({
      t_ms,
      ...levelled({ position: [...position], quaternion: [...quaternion] }, { up }),
    }));
    const written = writeMovement({ anchor: "scene", metadata: new Map([["scene", "my\nscene"]]), points });
    const trace = readMovement(written);
    expect(trace.metadata.get("scene")).toBe("my scene");
    for (const [i, point] of placed(trace, { up, camera: null }).entries()) {
      expect(point.t_ms).toBe(seen[i]?.t_ms);
      expectClose(point.position, seen[i]?.position ?? []);
      expectClose(point.quaternion, seen[i]?.quaternion ?? []);
    }
  });
});
