import { expect, test } from "vitest";
import { RtpFrames, StatsReader } from "./receiver-stats";

const video = (bytes: number, delay: number, emitted: number) =>
  new Map([
    ["T1", { type: "transport", bytesReceived: 9999 }],
    [
      "V1",
      {
        type: "inbound-rtp",
        kind: "video",
        bytesReceived: bytes,
        headerBytesReceived: 100,
        jitterBufferDelay: delay,
        jitterBufferEmittedCount: emitted,
        packetsLost: 3,
      },
    ],
  ]);

test("bytes are all so far, and the jitter buffer's delay that of the frames since the report before", () => {
  const reader = new StatsReader();
  expect(reader.read(new Map())).toBeNull();
  expect(reader.read(video(1000, 0, 0))).toEqual({ bytes: 1100, jitterBuffer: null, lost: 3 });
  expect(reader.read(video(2000, 0.4, 10))?.jitterBuffer).toBeCloseTo(40);
  expect(reader.read(video(3000, 0.5, 20))?.jitterBuffer).toBeCloseTo(10);
  expect(reader.read(video(3000, 0.5, 20))?.jitterBuffer).toBeCloseTo(10);
});

test("frames count on where timestamps begin anew, and a late one has its place", () => {
  const frames = new RtpFrames(30);
  const timestamps = [2 ** 32 - 3000, 0, 3000, 9000, 6000, 12_001];
  expect(timestamps.map((timestamp) => frames.number(timestamp))).toEqual([0, 1, 2, 4, 3, 5]);
});

test("each frame of 60 a second has a number of its own", () => {
  const frames = new RtpFrames(60);
  expect([7, 1507, 3007].map((timestamp) => frames.number(timestamp))).toEqual([0, 1, 2]);
});
