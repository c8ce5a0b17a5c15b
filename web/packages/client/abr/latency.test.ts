import { beforeEach, describe, expect, test } from "vitest";
import { type ObservationOptions, observation } from "#fakes/observation";
import { PAPER_LADDER } from "./ladder";
import { LatencyController, perRequest, perTransfer } from "./latency";

const BYTES = [240_000, 55_000, 20_000, 7000];
let subject: LatencyController;

/** Frames of the rung in use, as large as the ladder says. */
function hear(count: number, told: ObservationOptions): number[] {
  return Array.from({ length: count }, () => {
    const profile = subject.decide();
    subject.observe(observation({ profile, bytes: BYTES[profile] ?? 0, ...told }));
    return subject.decide();
  });
}

describe("per transfer", () => {
  beforeEach(() => {
    subject = new LatencyController({ ladder: PAPER_LADDER }, perTransfer());
  });

  // T of 20 kB within 100 ms takes 1.6 Mbit/s, of 55 kB 4.4, of 240 kB 19.2; above 120 ms is below 1.33, 3.67 and 16.
  test("one rung up once three frames in a row say that the next one takes at most 100 ms", () => {
    expect(hear(10, { throughput: 4.4e6 })).toEqual([3, 3, 2, 2, 2, 1, 1, 1, 1, 1]);
    expect(hear(6, { throughput: 19.1e6 })).toEqual([1, 1, 1, 1, 1, 1]);
    expect(hear(3, { throughput: 19.2e6 })).toEqual([1, 1, 0]);
  });

  test("between target and margin it stays, above the margin it goes down after three frames", () => {
    hear(9, { throughput: 20e6 });
    expect(hear(5, { throughput: 16.1e6 })).toEqual([0, 0, 0, 0, 0]);
    expect(hear(4, { throughput: 15.9e6 })).toEqual([0, 0, 1, 1]);
  });

  test("frames that disagree start the count anew", () => {
    expect([...hear(2, { throughput: 2e6 }), ...hear(1, { throughput: 1e6 }), ...hear(2, { throughput: 2e6 })]).toEqual(
      [3, 3, 3, 3, 3],
    );
  });

  test("during a fast turn it goes down at once, but not up", () => {
    expect(hear(2, { throughput: 30e6, turning: 200 })).toEqual([3, 3]);
    hear(9, { throughput: 30e6 });
    expect(hear(2, { throughput: 3e6, turning: 200 })).toEqual([1, 2]);
  });

  test("round trip and server do not count", () => {
    expect(hear(3, { throughput: 2e6, response: 900, server: 500 })).toEqual([3, 3, 2]);
  });

  test("nothing changes while the throughput is unknown", () => {
    expect(hear(5, { throughput: null })).toEqual([3, 3, 3, 3, 3]);
  });

  test("frames that are larger than the ladder says are known to be", () => {
    expect(hear(4, { throughput: 2e6, bytes: 14_000 })).toEqual([3, 3, 3, 3]);
  });
});

describe("per request", () => {
  beforeEach(() => {
    subject = new LatencyController({ ladder: PAPER_LADDER }, perRequest());
  });

  // 7 kB in 30 ms are 1.87 Mbit/s, by which 20 kB take 86 ms; in 40 ms they take 114.
  test("one rung up once three requests in a row say that a frame of the next takes at most 100 ms, all told", () => {
    expect(hear(4, { response: 30 })).toEqual([3, 3, 2, 2]);
  });

  test("round trip and server count, however fast the link is", () => {
    expect(hear(10, { response: 40, throughput: 1e9 })).toEqual(Array(10).fill(3));
  });

  test("it goes down when requests take longer than the margin", () => {
    hear(20, { response: 30 });
    const before = subject.decide();
    expect(before).toBeLessThan(2);
    expect(hear(10, { response: 250 }).at(-1)).toBeGreaterThan(before);
  });

  test("requests that came in no time, or empty, say nothing", () => {
    expect(hear(5, { response: 0 })).toEqual([3, 3, 3, 3, 3]);
    expect(hear(5, { bytes: 0, response: 30 })).toEqual([3, 3, 3, 3, 3]);
  });
});
