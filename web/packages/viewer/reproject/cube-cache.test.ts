import { expect, test } from "vitest";
import { fakeView, turned } from "#fakes/views";
import { FACES, facesSeen } from "./cube-cache";
import { apply } from "./view";

const [RIGHT, LEFT, DOWN, UP, AHEAD, BEHIND] = [0, 1, 2, 3, 4, 5] as const;
const pitched = (degrees: number) =>
  ({ quaternion: [Math.sin((degrees * Math.PI) / 360), 0, 0, Math.cos((degrees * Math.PI) / 360)] }) as const;

test("each side is in the middle of its axis", () => {
  expect(FACES.map((face) => apply(face, [0, 0, 1]))).toEqual([
    [1, 0, 0],
    [-1, 0, 0],
    [0, 1, 0],
    [0, -1, 0],
    [0, 0, 1],
    [0, 0, -1],
  ]);
});

test.each([
  ["ahead", {}, [AHEAD]],
  ["to the right", turned(90), [RIGHT]],
  ["between two", turned(45), [RIGHT, AHEAD]],
  ["over the shoulder", turned(-135), [LEFT, BEHIND]],
  ["up", pitched(90), [UP]],
  ["down, not wholly", { ...pitched(-50), fx: 200 }, [DOWN, AHEAD]],
  ["ahead with a wide lens", { fx: 20, fy: 20 }, [RIGHT, LEFT, DOWN, UP, AHEAD]],
] as const)("looking %s", (_, changes, faces) => {
  expect(facesSeen(fakeView(changes))).toEqual(faces);
});
