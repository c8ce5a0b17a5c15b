import { expect, test } from "vitest";
import type { FrameReply } from "../transport/transport";
import { StatsRecorder } from "./stats";

function reply(sentAt: number, lastByteAt: number): FrameReply {
  return {
    header: {
      status: 200,
      seq: 1,
      content_type: "image/jpeg",
      width: 640,
      height: 360,
      profile: 2,
      timing: { queue: 1, render: 2, encode: 3 },
    },
    image: new Blob(["12345"]),
    arrival: { sentAt, firstByteAt: lastByteAt - 10, lastByteAt, bytes: 100, sharedBytes: 10_000 },
  };
}

const current = { transport: "fetch", inFlight: 2, settled: false } as const;

test("shows what the frames said", () => {
  const subject = new StatsRecorder();
  for (let i = 0; i < 10; i++) {
    subject.replied(reply(i * 50, i * 50 + 40), i * 50 + 40);
    subject.presented([60 + i], i * 50 + 60);
  }
  expect(subject.snapshot(510, current)).toMatchObject({
    motionToPhoton: { p50: 64, p95: 69 },
    roundTrip: 40,
    server: { queue: 1, render: 2, encode: 3 },
    frame: { bytes: 5, width: 640, height: 360, profile: 2 },
    throughput: 8_000_000,
    shown: 10,
    inFlight: 2,
  });
  expect(subject.snapshot(510, current).framesPerSecond).toBeCloseTo(20, 0);
});

test("while nothing moves there is no latency and no frame rate, but what is known stays", () => {
  const subject = new StatsRecorder();
  subject.replied(reply(0, 40), 40);
  subject.presented([60], 60);
  const later = subject.snapshot(60_000, current);
  expect(later).toMatchObject({ framesPerSecond: 0, motionToPhoton: null, shown: 1 });
  expect(later.frame?.width).toBe(640);
});

test("before the first frame everything is empty", () => {
  expect(new StatsRecorder().snapshot(0, current)).toMatchObject({
    frame: null,
    server: null,
    throughput: null,
    roundTrip: null,
  });
});
