import { expect, test } from "vitest";
import { Receiver } from "../transport/reception";
import { ThroughputEstimator } from "./throughput";

const sample = (bytes: number, ms: number) => ({ firstByteAt: 0, lastByteAt: ms, sharedBytes: bytes, bytes });
/** A frame received in one piece. */
const piece = (bytes: number) => ({ firstByteAt: 0, lastByteAt: 0, sharedBytes: 0, bytes });

test("unknown before the first frame", () => {
  expect(new ThroughputEstimator().bitsPerSecond).toBeNull();
});

test("the moving average of the last five, the newest with weight 0.3", () => {
  const subject = new ThroughputEstimator();
  for (const bytes of [999_999, 1000, 1000, 1000, 1000, 2000]) subject.observe(sample(bytes, 10));
  expect(subject.bitsPerSecond).toBeCloseTo(0.7 * 800_000 + 0.3 * 1_600_000, 3);
});

test("several frames in flight do not make the link look slower", () => {
  // A link of 1000 bytes per millisecond, with packets of four frames in turn.
  let now = 0;
  const receiver = new Receiver(() => now);
  const frames = Array.from({ length: 4 }, () => receiver.begin());
  for (let i = 0; i < 200; i++) {
    now += 1;
    frames[i % 4]?.add(1000);
  }
  const subject = new ThroughputEstimator();
  for (const frame of frames) subject.observe(frame.arrival);
  expect(subject.bitsPerSecond).toBeCloseTo(8_000_000, 0);
});

test("bits of a millisecond are added up", () => {
  const subject = new ThroughputEstimator();
  for (let i = 0; i < 4; i++) subject.observe(sample(500, 0.5));
  expect(subject.bitsPerSecond).toBeCloseTo(8_000_000, 0);
});

test("frames that come in one piece, five times in a row, say how fast the link is at least", () => {
  const subject = new ThroughputEstimator();
  for (let i = 0; i < 4; i++) subject.observe(piece(7000));
  expect(subject.bitsPerSecond).toBeNull();
  subject.observe(piece(7000));
  expect(subject.bitsPerSecond).toBeCloseTo(28_000_000, 0); // 7 kB in 2 ms
});

test("what is known to be faster is not forgotten for frames too small to tell", () => {
  const subject = new ThroughputEstimator();
  subject.observe(sample(50_000, 4));
  for (let i = 0; i < 20; i++) subject.observe(piece(7000));
  expect(subject.bitsPerSecond).toBeCloseTo(100_000_000, 0);
});

test.each([2, 5, 15])(
  "frames of %i packets that are heard of every 4 ms tell of 24 Mbit/s what they can",
  (packets) => {
    let now = 0;
    const receiver = new Receiver(() => now);
    const subject = new ThroughputEstimator();
    const read: number[] = [];
    for (let frame = 0; frame < 2000; frame++) {
      const reception = receiver.begin();
      const chunks = new Map<number, number>();
      for (let i = 0; i < packets; i++) {
        const arrives = frame * 16.7 + i * 0.4747; // 1424 bytes at 24 Mbit/s
        const heard = 4 * Math.ceil(arrives / 4);
        chunks.set(heard, (chunks.get(heard) ?? 0) + 1424);
      }
      for (const [at, bytes] of chunks) {
        now = at;
        reception.add(bytes);
      }
      subject.observe(reception.arrival);
      read.push(subject.bitsPerSecond ?? 0);
    }
    const median = read.toSorted((a, b) => a - b)[1000] ?? 0;
    expect(median).toBeGreaterThan(0.7 * 24e6);
    expect(median).toBeLessThan(1.4 * 24e6);
  },
);
