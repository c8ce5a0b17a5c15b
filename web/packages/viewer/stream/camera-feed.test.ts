import { beforeEach, describe, expect, test } from "vitest";
import type { PoseUpdate } from "#client/wire/dash";
import { STILL, steeredRig } from "#fakes/rig";
import { fakeView } from "#fakes/views";
import { Foresight } from "../predict/foresight";
import type { PredictorName } from "../predict/registry";
import type { Rig } from "../view/rig";
import { CameraFeed, widened } from "./camera-feed";

let axes: typeof STILL;
let rig: Rig;
let foresight: Foresight;
let prediction: PredictorName;
let sent: PoseUpdate[];
let busy: boolean;
let now: number;

beforeEach(() => {
  axes = STILL;
  sent = [];
  busy = false;
  now = 0;
  prediction = "off";
  rig = steeredRig(() => axes);
  rig.resize(640, 360);
  rig.sample(0);
  foresight = new Foresight(rig, () => prediction);
});

function feed(overscan: number | null): CameraFeed {
  const made = new CameraFeed({ rig, foresight, overscan });
  made.open(now);
  return made;
}

/** Runs an animation frame. */
function frame(subject: CameraFeed): PoseUpdate | undefined {
  now += 16;
  rig.sample(now);
  const before = sent.length;
  subject.follow(now, (update) => !busy && sent.push(update) > 0);
  return sent[before];
}

test("a stream that is shown as it comes is told each pose once, by its number", () => {
  const subject = feed(null);
  expect(frame(subject)).toMatchObject({ seq: rig.pose.seq, cx: 320, cy: 180 });
  expect(frame(subject)).toBeUndefined();
  axes = { ...STILL, turnRight: 1 };
  expect(frame(subject)?.seq).toBe(rig.pose.seq);
});

test("a stream that is turned shows more at each side, and its messages say what they say", () => {
  const subject = new CameraFeed({ rig, foresight, overscan: 0.1 });
  const first = subject.open(5);
  expect(first).toMatchObject({ width: 768, height: 432, cx: 384, cy: 216, quaternion: rig.pose.quaternion });
  expect(subject.told(0)).toMatchObject({ pose: rig.pose.seq, at: 5, view: first, asked: { width: 640, cx: 320 } });
  axes = { ...STILL, turnRight: 1 };
  const update = frame(subject);
  expect(update).toMatchObject({ seq: 1, cx: 384, cy: 216, quaternion: rig.pose.quaternion });
  expect(update).not.toHaveProperty("width");
  rig.lens.value = { fx: 900, fy: 900 };
  axes = STILL;
  frame(subject);
  const [one, two] = [subject.told(1), subject.told(2)];
  expect([one?.pose, two?.pose]).toEqual([rig.pose.seq, rig.pose.seq]);
  expect(one?.view.fx).toBeLessThan(900);
  expect(two?.view).toMatchObject({ fx: 900, width: 768 });
});

test("what could not be sent is sent later, unless something newer is", () => {
  const subject = feed(0.1);
  axes = { ...STILL, turnRight: 1 };
  busy = true;
  frame(subject);
  expect(subject.told(1)).toBeUndefined();
  busy = false;
  expect(frame(subject)).toMatchObject({ seq: 1, quaternion: rig.pose.quaternion });
});

test("a stage of another size waits for another stream: the lens stays", () => {
  const subject = feed(0.1);
  rig.resize(320, 180);
  expect(frame(subject)).toMatchObject({ cx: 384, cy: 216 });
});

test("a prediction is told as one, and what it comes to once the camera rests", () => {
  prediction = "velocity";
  const subject = feed(0.1);
  axes = { ...STILL, turnRight: 1 };
  for (let i = 0; i < 10; i++) {
    frame(subject);
    foresight.shown(now - 100, now);
  }
  expect(sent.at(-1)?.quaternion).not.toEqual(rig.pose.quaternion);
  expect(subject.told(sent.at(-1)?.seq ?? 0)?.pose).toBe(rig.pose.seq);
  axes = STILL;
  for (let i = 0; i < 30; i++) frame(subject);
  expect(sent.at(-1)?.quaternion).toEqual(rig.pose.quaternion);
  const messages = sent.length;
  frame(subject);
  expect(sent).toHaveLength(messages);
});

test("what was told long ago is forgotten, but for the last message", () => {
  const subject = feed(0.1);
  axes = { ...STILL, turnRight: 1 };
  for (let i = 0; i <= CameraFeed.KEPT; i++) frame(subject);
  expect(subject.told(1)).toBeUndefined();
  expect(subject.told(sent.at(-1)?.seq ?? 0)?.pose).toBe(rig.pose.seq);
});

describe("wider", () => {
  const VIEW = fakeView({ position: [1, 2, 3], fx: 300, fy: 310, cx: 320, cy: 170, width: 640, height: 360 });

  test("what is in the middle stays as it was, with margins around it", () => {
    expect(widened(VIEW, 0.1)).toEqual({ ...VIEW, cx: 384, cy: 206, width: 768, height: 432 });
    expect(widened(VIEW, 0)).toEqual(VIEW);
  });

  test("a viewport that the server would refuse is sampled less finely, with the same field of view", () => {
    const { width, height, fx, fy, cx, cy } = widened({ ...VIEW, width: 8192, height: 2048, cx: 4096, cy: 1024 }, 0.1);
    expect(width).toBeLessThanOrEqual(8192);
    expect(height).toBeLessThanOrEqual(2048);
    expect(cx).toBeCloseTo(width / 2);
    expect(cy).toBeCloseTo(height / 2);
    expect(width / fx).toBeCloseTo((8192 + 2 * 819) / 300);
    expect(height / fy).toBeCloseTo((2048 + 2 * 205) / 310);
  });
});
