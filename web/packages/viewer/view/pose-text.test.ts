import { expect, test } from "vitest";
import { poseOf, poseText } from "./pose-text";

test("a pose comes back from its text, rounded", () => {
  const text = poseText({ position: [1.25, -2, 1234.5678], quaternion: [0, 0.6, 0, 0.8] });
  expect(text).toBe("1.25,-2,1234.57,0,0.6,0,0.8");
  expect(poseOf(text)).toEqual({ position: [1.25, -2, 1234.57], quaternion: [0, 0.6, 0, 0.8] });
});

test("a rotation of any length is one of length 1", () => {
  expect(poseOf("0, 0, 0, 0, 3, 0, 4")?.quaternion).toEqual([0, 0.6, 0, 0.8]);
});

test.each(["", "1,2,3", "1,2,3,0,0,0,0", "1,2,x,0,0,0,1", "1,2,3,0,0,0,1,9", "1e999,2,3,0,0,0,1", "1,2,3,,,,1"])(
  "%j is no pose",
  (at) => {
    expect(poseOf(at)).toBeNull();
  },
);
