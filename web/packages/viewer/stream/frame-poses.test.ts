import { beforeEach, expect, test } from "vitest";
import { FramePoses } from "./frame-poses";

let matched: [pose: number, presented: string][];
let subject: FramePoses<string>;

beforeEach(() => {
  matched = [];
  subject = new FramePoses((pose, presented) => matched.push([pose, presented]));
});

test("a frame that was told of is matched when it is presented", () => {
  subject.told(7, 70);
  subject.told(8, 80);
  subject.presented(8, "a");
  expect(matched).toEqual([[80, "a"]]);
});

test("a frame that is presented before it was told of is matched then", () => {
  subject.presented(7, "a");
  expect(matched).toEqual([]);
  subject.told(6, 60);
  subject.told(7, 70);
  expect(matched).toEqual([[70, "a"]]);
});

test("each frame is matched once", () => {
  subject.presented(7, "a");
  subject.told(7, 70);
  subject.told(7, 70);
  expect(matched).toHaveLength(1);
});

test("what is old is forgotten", () => {
  subject.told(1, 10);
  for (let frame = 2; frame <= FramePoses.KEPT + 1; frame++) subject.told(frame, frame * 10);
  subject.presented(1, "late");
  expect(matched).toEqual([]);
});

test("what is old is forgotten though the stream left frames out", () => {
  subject.told(1, 10);
  subject.told(FramePoses.KEPT + 9, 90);
  subject.presented(1, "late");
  expect(matched).toEqual([]);
});
