import { expect, test } from "vitest";
import { StatsReader } from "./receiver-stats";

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
