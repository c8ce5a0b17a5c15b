import { expect, test } from "vitest";
import type { FrameReply } from "#client/transport/transport";
import { StatsRecorder } from "./stats";

function reply(sentAt: number, lastByteAt: number, render = 2, profile: number | null = 2): FrameReply {
  return {
    header: {
      status: 200,
      seq: 1,
      content_type: "image/jpeg",
      width: 640,
      height: 360,
      profile,
      timing: { queue: 1, render, encode: 3 },
    },
    image: new Blob(["12345"]),
    arrival: { sentAt, firstByteAt: lastByteAt - 10, lastByteAt, bytes: 100, sharedBytes: 10_000 },
  };
}

test("shows what the frames said", () => {
  const subject = new StatsRecorder();
  for (let i = 0; i < 10; i++) subject.replied(reply(i * 50, i * 50 + 40), i * 50 + 40);
  expect(subject.snapshot(510)).toEqual({
    roundTrip: 40,
    server: { queue: 1, render: 2, encode: 3 },
    serverBound: false,
    frame: { bytes: 5, width: 640, height: 360, profile: 2 },
    throughput: 8_000_000,
  });
});

test("says that a frame came as WebP", () => {
  const subject = new StatsRecorder();
  const { header, ...rest } = reply(0, 40);
  subject.replied({ header: { ...header, content_type: "image/webp" }, ...rest }, 40);
  expect(subject.snapshot(50).frame?.webp).toBe(true);
});

test("what is known stays while nothing moves", () => {
  const subject = new StatsRecorder();
  subject.replied(reply(0, 40), 40);
  const { frame, roundTrip, server } = subject.snapshot(60_000);
  expect([frame?.width, roundTrip, server]).toEqual([640, 40, { queue: 1, render: 2, encode: 3 }]);
});

test("one frame that the server took long for changes its time as little as the response time", () => {
  const subject = new StatsRecorder();
  for (let i = 0; i < 10; i++) subject.replied(reply(i * 50, i * 50 + 40, i === 9 ? 300 : 12), i * 50 + 40);
  expect(subject.snapshot(510).server?.render).toBe(12);
});

test.each([
  ["a renderer that takes most of the time", 120, 90, 2, true],
  ["a slow link", 400, 90, 2, false],
  ["a renderer that is quick enough for anybody", 40, 30, 2, false],
  ["refined frames, which take their time", 120, 90, null, false],
])("%s: is the server the limit?", (_, response, render, profile, bound) => {
  const subject = new StatsRecorder();
  for (let i = 0; i < 10; i++) subject.replied(reply(i * 50, i * 50 + response, render, profile), i * 50 + response);
  expect(subject.snapshot(900).serverBound).toBe(bound);
});

test("before the first frame everything is empty", () => {
  expect(new StatsRecorder().snapshot(0)).toEqual({
    frame: null,
    server: null,
    serverBound: false,
    throughput: null,
    roundTrip: null,
  });
});
