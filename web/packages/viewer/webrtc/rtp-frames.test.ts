import { expect, test } from "vitest";
import { RtpFrames } from "./rtp-frames";

test("frames count on where timestamps begin anew, and a late one has its place", () => {
  const frames = new RtpFrames(30);
  const timestamps = [2 ** 32 - 3000, 0, 3000, 9000, 6000, 12_001];
  expect(timestamps.map((timestamp) => frames.number(timestamp))).toEqual([0, 1, 2, 4, 3, 5]);
});

test("each frame of 60 a second has a number of its own", () => {
  const frames = new RtpFrames(60);
  expect([7, 1507, 3007].map((timestamp) => frames.number(timestamp))).toEqual([0, 1, 2]);
});
