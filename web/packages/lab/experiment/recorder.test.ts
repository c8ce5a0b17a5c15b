import { expect, test } from "vitest";
import type { Reply } from "#viewer/stateless/stateless-player";
import type { ScenePose } from "#viewer/view/camera";
import type { PresentedFrame } from "#viewer/view/presented";
import { displayInterval, intervalAtRest, missedFrames, Recorder, type RecorderStart } from "./recorder";

const posed = (seq: number) => ({ seq, position: [seq, 0, 0], quaternion: [0, 0, 0, 1] }) as never;

function frame(at: number, seq: number, more: Partial<PresentedFrame> = {}): PresentedFrame {
  return { side: "stateless", at, pose: seq, latencies: [], rung: 2, width: 640, height: 360, ...more };
}

function reply(sentAt: number, lastByteAt: number, more: Partial<Reply> = {}): Reply {
  const arrival = { sentAt, firstByteAt: lastByteAt - 2, lastByteAt, bytes: 7000, sharedBytes: 0 };
  const server = { queue: 0.5, render: 11, encode: 1 };
  const observation = { profile: 3, arrival, server, throughput: 12_345_678, inFlight: 1, turning: 0, at: lastByteAt };
  return { ...observation, way: "stale", pose: 4, asked: 2, ...more };
}

/** Along x, a unit a millisecond. */
const walk = (elapsed: number): ScenePose => ({ position: [elapsed, 0, 0], quaternion: [0, 0, 0, 1] });
const recorderFrom = (start: Omit<RecorderStart, "duration" | "movement" | "captureOffset"> & Partial<RecorderStart>) =>
  new Recorder({ duration: 3500, movement: walk, captureOffset: 0, ...start });

test("keeps each pose once, since the run's start", () => {
  const recorder = recorderFrom({ startedAt: 1000, pose: 5, received: 0, captureEvery: 0 });
  for (const [seq, at] of [
    [5, 1000],
    [6, 1016],
    [6, 1033],
    [7, 1050],
  ] as const)
    recorder.sampled(posed(seq), at);
  expect(recorder.events.inputs.map(({ at, pose }) => [at, pose])).toEqual([
    [16, 6],
    [50, 7],
  ]);
});

test("what the page did not sample while it stalled is an input, too, that the next pose answers", () => {
  const recorder = recorderFrom({ startedAt: 1000, pose: 5, received: 0, captureEvery: 0 });
  [1000, 1020, 1040, 1100, 1120, 1140].forEach((at, i) => {
    recorder.sampled(posed(5 + i), at);
  });
  expect(recorder.displayInterval).toBe(20);
  expect(recorder.events.inputs.map(({ at, pose, missed }) => [at, pose, missed])).toEqual([
    [20, 6, false],
    [40, 7, false],
    [60, 8, true],
    [80, 8, true],
    [100, 8, false],
    [120, 9, false],
    [140, 10, false],
  ]);
  expect(recorder.events.inputs[2]?.position).toEqual([60, 0, 0]);
});

test("a page that is slow all the time misses the display's frames in between", () => {
  const recorder = recorderFrom({ startedAt: 0, pose: 5, received: 0, captureEvery: 0, atRest: 20 });
  [0, 60, 120].forEach((at, i) => {
    recorder.sampled(posed(5 + i), at);
  });
  expect([recorder.animationInterval, recorder.displayInterval]).toEqual([60, 20]);
  expect(recorder.events.inputs.filter(({ missed }) => missed).map(({ at }) => at)).toEqual([20, 40, 80, 100]);
});

test("a stall misses nothing while the movement stands", () => {
  const movement = (elapsed: number) => walk(Math.min(40, elapsed));
  const recorder = recorderFrom({ startedAt: 0, pose: 5, received: 0, captureEvery: 0, movement });
  [0, 20, 40, 200, 220].forEach((at, i) => {
    recorder.sampled(posed(5 + Math.min(2, i)), at);
  });
  expect(recorder.events.inputs.map(({ at }) => at)).toEqual([20, 40]);
});

test("says what became of each request by the end", () => {
  const recorder = recorderFrom({ startedAt: 100, pose: 0, received: 0, captureEvery: 0 });
  const request = { at: 120, pose: 4, asked: 2, fate: "unanswered" as "unanswered" | "shown" };
  recorder.sent(request);
  recorder.sent({ at: 140, pose: 5, asked: null, fate: "unanswered" });
  request.fate = "shown";
  expect(recorder.events.requests).toEqual([
    { at: 20, pose: 4, asked_rung: 2, fate: "shown" },
    { at: 40, pose: 5, asked_rung: null, fate: "unanswered" },
  ]);
});

test("puts frames in the order of time, and leaves out what was on the screen before", () => {
  const recorder = recorderFrom({ startedAt: 1000, pose: 0, received: 0, captureEvery: 0 });
  recorder.presented(frame(990, 0));
  recorder.presented(frame(1060, 2));
  recorder.presented(frame(1040, 1));
  expect(recorder.events.frames.map(({ at }) => at)).toEqual([40, 60]);
});

test("tells what the page turned a frame to, apart from the pose that its pixels are of", () => {
  const recorder = recorderFrom({ startedAt: 1000, pose: 0, received: 0, captureEvery: 0 });
  recorder.presented(frame(1020, 2));
  recorder.presented(frame(1036, 2, { view: 4, filled: 0.02, warpMs: 0.6 }));
  expect(
    recorder.events.frames.map(({ at, pose, view, filled, warp_ms }) => [at, pose, view, filled, warp_ms]),
  ).toEqual([
    [20, 2, null, null, null],
    [36, 2, 4, 0.02, 0.6],
  ]);
});

test("keeps each reply in the order of time: what was asked for, and when and how it came", () => {
  const recorder = recorderFrom({ startedAt: 1000, pose: 0, received: 0, captureEvery: 0 });
  recorder.replied(reply(1030, 1070, { throughput: null, server: null, profile: null, asked: null }));
  recorder.replied(reply(990, 1040));
  const [first, second] = recorder.events.replies;
  expect(first).toEqual({
    at: 40,
    asked_at: -10,
    first_byte_at: 38,
    pose: 4,
    asked_rung: 2,
    rung: 3,
    bytes: 7000,
    server: { queue: 0.5, render: 11, encode: 1 },
    throughput_kbps: 12_346,
  });
  expect(second).toMatchObject({ at: 70, asked_rung: null, rung: null, server: null, throughput_kbps: null });
});

test("a picture is due at each tick of the clock while the movement lasts, whatever is shown", () => {
  const recorder = recorderFrom({ startedAt: 100, pose: 0, received: 0, captureEvery: 1000, captureOffset: 300 });
  const due = [100, 390, 410, 420, 1390, 1400, 1410, 3700, 3720, 9000].map((now) => recorder.due(now));
  expect(due).toEqual([0, 0, 1, 0, 0, 1, 0, 2, 0, 0]);
});

test("no picture is due if none is wanted", () => {
  const recorder = recorderFrom({ startedAt: 0, pose: 0, received: 0, captureEvery: 0 });
  expect(recorder.due(5000)).toBe(0);
});

test("is settled when the movement's last pose is on the screen, and not while a page that stands has yet to sample it", () => {
  const recorder = recorderFrom({ startedAt: 0, pose: 3, received: 0, captureEvery: 0, duration: 10 });
  recorder.sampled(posed(3), 9);
  expect(recorder.settled).toBe(false);
  recorder.sampled(posed(5), 10);
  recorder.presented(frame(20, 4));
  expect(recorder.settled).toBe(false);
  recorder.presented(frame(30, 5));
  recorder.presented(frame(40, 4));
  expect(recorder.settled).toBe(true);
});

test("counts what came in since the start", () => {
  const recorder = recorderFrom({ startedAt: 100, pose: 0, received: 7000, captureEvery: 0 });
  recorder.received(7000, 100);
  recorder.received(9500, 350);
  expect(recorder.events.traffic).toEqual([
    { at: 0, bytes: 0 },
    { at: 250, bytes: 2500 },
  ]);
});

test("a captured frame keeps its own size, what it was turned to, and since when it was on the screen", () => {
  const recorder = recorderFrom({ startedAt: 100, pose: 0, received: 0, captureEvery: 1000 });
  recorder.captured(frame(1050, 9), 1200, { width: 320, height: 180 });
  recorder.captured(frame(1216, 10, { view: 12, filled: 0.1 }), 1200, { width: 320, height: 180 });
  expect(recorder.events.captures).toEqual([
    { at: 1100, shown_at: 950, pose: 9, view: null, filled: null, rung: 2, width: 320, height: 180 },
    { at: 1116, shown_at: 1116, pose: 10, view: 12, filled: 0.1, rung: 2, width: 320, height: 180 },
  ]);
});

const every = (interval: number, count: number, jitter = 0) =>
  Array.from({ length: count }, (_, i) => i * interval + (i % 2) * jitter);

test.each([
  ["steady", every(20, 50), 20],
  ["jittering", every(20, 51, 4), 20],
  [
    "that misses every other frame for most of the time",
    [...every(20, 12), ...every(40, 40).map((at) => at + 260)],
    20,
  ],
])("the interval of a display %s", (_, times, interval) => {
  expect(displayInterval(times)).toBe(interval);
});

test("the interval at rest is the usual one, and unknown with few frames", () => {
  expect(intervalAtRest([...every(20, 30), 800, 803])).toBe(20);
  expect(intervalAtRest(every(20, 20))).toBeNull();
});

test("one animation frame has no interval, nor have two at the same time", () => {
  expect([displayInterval([]), displayInterval([5]), displayInterval([5, 5])]).toEqual([null, null, null]);
});

test.each([
  ["none in a steady loop", [0, 20, 40, 60], []],
  ["none where a frame comes a little late", [0, 20, 49, 60], []],
  ["one in a double gap", [0, 20, 60, 80], [40]],
  ["all in a stall, at the display's own times", [0, 20, 121], [40, 60, 80, 100]],
])("frames are missed: %s", (_, times, missed) => {
  expect(missedFrames(times, 20)).toEqual(missed);
});

test("keeps no more pictures than the duration has room for", () => {
  const duration = 7000;
  const captureEvery = duration / 120;
  const recorder = recorderFrom({ startedAt: 0, pose: 0, received: 0, captureEvery, captureOffset: 0, duration });
  let kept = 0;
  for (let now = 0; now <= duration; now += 5) kept += recorder.due(now);
  expect(kept).toBe(120);
});
