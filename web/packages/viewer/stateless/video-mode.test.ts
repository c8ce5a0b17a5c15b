/** The mode `video`: the same requests as in the mode `stateless`, answered by the frames of a video. */

import { beforeEach, expect, test } from "vitest";
import { videoLadder } from "#client/abr/video-ladder";
import { PLACE } from "#fakes/gpu";
import { PlayerBench } from "#fakes/player-bench";
import { STILL } from "#fakes/rig";
import { settle } from "#fakes/transport";

const STEPS = videoLadder(PLACE.ladder);

let bench: PlayerBench;

beforeEach(() => {
  bench = new PlayerBench();
  bench.videoSteps = STEPS;
});

test("asks for the step's rung and bit rate, at first for a key frame, and decodes what comes", async () => {
  bench.profile = 1;
  await bench.frames(3);
  bench.axes = { ...STILL, forward: 1 };
  await bench.frames(4);
  const requests = bench.transport.requests.map(({ request }) => request);
  expect(requests[0]).toMatchObject({
    format: "h264",
    profile: STEPS[1]?.rung,
    video: { ...STEPS[1]?.video, key: true },
  });
  expect(requests.slice(1).map(({ video }) => video)).toEqual(requests.slice(1).map(() => STEPS[1]?.video));
  expect(bench.videoDecoder.decoded.length).toBe(requests.length);
  expect(bench.shown.length).toBeGreaterThan(2);
  expect(bench.player.stats.value.video).toMatchObject({
    bitrate: (STEPS[1]?.video.bitrate_kbps ?? 0) * 1000,
    keyFrames: 1,
  });
});

test("the controller hears of the step that it chose, and the recording of the rung", async () => {
  const heard: (number | null)[] = [];
  bench.observed = ({ profile }) => heard.push(profile);
  bench.profile = STEPS.length - 1;
  await bench.frames(3);
  expect(heard).toEqual([STEPS.length - 1]);
  expect(bench.replies.map(({ asked, profile }) => [asked, profile])).toEqual([
    [STEPS.at(-1)?.rung, STEPS.at(-1)?.rung],
  ]);
});

test("while pictures are turned, margins stay as they are, and there is no depth to ask for", async () => {
  bench.reprojector.on(4);
  await bench.frames(5);
  bench.axes = { ...STILL, turnRight: 1 };
  await bench.frames(20);
  const margins = bench.transport.requests.map(({ request: { overscan, depth } }) => [overscan, depth]);
  expect(new Set(margins.map(String))).toEqual(new Set(["0.1,"]));
});

test("a view that rests is refined by a picture by itself, and the video goes on where it was", async () => {
  bench.refine = true;
  await bench.frames(40);
  const refined = bench.last();
  expect(refined).toMatchObject({ width: 2560 });
  expect([refined?.format, refined?.video]).toEqual([undefined, undefined]);
  bench.axes = { ...STILL, forward: 1 };
  await bench.frames(5);
  expect(bench.last()).toMatchObject({ format: "h264", video: STEPS[0]?.video });
  expect(bench.player.stats.value.video?.keyFrames).toBe(1);
});

test("nothing is asked for while the browser cannot decode", async () => {
  bench = new PlayerBench(undefined, "This browser does not decode H.264.");
  bench.videoSteps = STEPS;
  await settle();
  await bench.frames(5);
  expect(bench.transport.requests).toEqual([]);
});

test("a frame that the decoder failed on is asked for again, as a key frame", async () => {
  bench.videoDecoder.failure = { name: "EncodingError", message: "Decoding error." };
  await bench.frames(2);
  bench.videoDecoder.failure = null;
  await bench.frames(20);
  expect(bench.transport.requests.length).toBeGreaterThan(1);
  expect(bench.transport.requests.every(({ request }) => request.video?.key === true)).toBe(true);
  expect(bench.player.stats.value).toMatchObject({ settled: true, shown: 1 });
});
