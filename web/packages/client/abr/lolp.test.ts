import { beforeEach, expect, test } from "vitest";
import { type ObservationOptions, observation } from "#fakes/observation";
import { PAPER_LADDER } from "./ladder";
import { LolpController } from "./lolp";
import { seeded } from "./random";

const BYTES = [240_000, 55_000, 20_000, 7000];
let subject: LolpController;

beforeEach(() => {
  subject = new LolpController({ ladder: PAPER_LADDER, random: seeded(1) });
});

function hear(count: number, told: ObservationOptions): number {
  for (let i = 0; i < count; i++) {
    const profile = subject.decide();
    subject.observe(observation({ profile, bytes: BYTES[profile] ?? 0, ...told }));
  }
  return subject.decide();
}

// At 60 requests/s the rungs take 3.36, 9.6, 26.4 and 115.2 Mbit/s, of which 0.9 of the throughput is trusted.
test("it uses what the link carries", () => {
  expect(hear(5, { throughput: 160e6, response: 40 })).toBe(0);
  expect(hear(5, { throughput: 32e6, response: 40 })).toBe(1);
  expect(hear(5, { throughput: 6e6, response: 40 })).toBe(3);
});

test("where the link carries no bitrate at all it stays where it is, as published", () => {
  hear(5, { throughput: 32e6, response: 40 });
  expect(hear(5, { throughput: 2e6, response: 40 })).toBe(1);
});

test("it goes down when frames come 90 ms later than the fastest, to what the link carries", () => {
  hear(5, { throughput: 160e6, response: 40 });
  expect(hear(1, { throughput: 160e6, response: 130 })).toBe(1);
  expect(hear(5, { throughput: 160e6, response: 130 })).toBe(3);
});

test.each([0.25, 1, 4])("frames that are all %f times as large change nothing on a link as much faster", (scale) => {
  const link = (throughput: number, response: number) => {
    for (let i = 0; i < 30; i++) {
      const profile = subject.decide();
      const bytes = (BYTES[profile] ?? 0) * scale;
      subject.observe(observation({ profile, bytes, throughput: throughput * scale, response }));
    }
    return subject.decide();
  };
  expect([link(40e6, 40), link(12e6, 30), link(160e6, 50), link(32e6, 45), link(32e6, 120)]).toEqual([1, 2, 0, 1, 3]);
});

test("nothing changes while the throughput is unknown", () => {
  expect(hear(5, { throughput: null })).toBe(3);
});
