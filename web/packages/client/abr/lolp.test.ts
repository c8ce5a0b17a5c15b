import { beforeEach, describe, expect, test } from "vitest";
import { type ObservationOptions, observation } from "#fakes/observation";
import { PAPER_LADDER } from "./ladder";
import {
  bestWeights,
  distance,
  downloadTime,
  firstWeights,
  LolpController,
  nextBuffer,
  qoe,
  SelfOrganisingMap,
} from "./lolp";
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

describe("lolp qoe", () => {
  const RATES = [1e6, 4e6];
  const QUESTION = {
    rates: RATES,
    latencies: [0.01, 0.02],
    throughput: 8e6,
    buffer: 1,
    minBuffer: 0.3,
  };

  // Worked by hand from the published weights: segment 0.5 s, rebuffering costs the highest bitrate in kbit/s a second,
  // latency 0.05 of the lowest up to 1.1 s and 0.1 of the highest above.
  test("the QoE of a segment", () => {
    expect(qoe(4e6, 0.1, 1.0, RATES)).toBeCloseTo(2e6 - 400 - 50, 6);
    expect(qoe(4e6, 0.1, 1.2, RATES)).toBeCloseTo(2e6 - 400 - 480, 6);
    expect(qoe(1e6, 0, 0, RATES)).toBeCloseTo(500_000, 6);
  });

  test("the buffer gains what a segment lasts and loses what it took, or loses a segment", () => {
    expect(downloadTime(4e6, 8e6)).toBeCloseTo(0.25, 12);
    expect(nextBuffer(1, 0.25)).toBeCloseTo(1.25, 12);
    expect(nextBuffer(1, 0.75)).toBeCloseTo(0.5, 12);
  });

  test("the weights that make least of rebuffering and latency promise the most", () => {
    expect(bestWeights(QUESTION)).toEqual([0.2, 1, 1, 0.2]);
  });

  test("equal promises are settled by the first option: a neuron that knows no latency gives latency the least weight", () => {
    expect(bestWeights({ ...QUESTION, latencies: [0, 0] })).toEqual([0.2, 0.2, 1, 0.2]);
  });

  test("none, where the buffer is low whatever is chosen", () => {
    expect(bestWeights({ ...QUESTION, buffer: 0.1, throughput: 1e5 })).toBeNull();
  });
});

describe("lolp som", () => {
  test("a weighted distance", () => {
    expect(distance([1, 2, 3, 4], [1, 0, 3, 1])).toBeCloseTo(Math.sqrt(13), 12);
    expect(distance([1, 0, 0, 0], [0, 0, 0, 0], [100, 1, 1, 1])).toBeCloseTo(10, 12);
  });

  // Worked by hand: learning rate 0.01; the other neuron is 0.2 away, so it learns exp(-0.2² / (2 · 0.1²)) = exp(-2) as much.
  test("a neuron is drawn to what happened, its neighbours less", () => {
    const map = new SelfOrganisingMap([0.8, 0.6], 0.01);
    map.learn(1, [1, 1, 0, 0]);
    const [neighbour, drawn] = map.neurons;
    expect(drawn).toEqual([0.6 + 0.01 * 0.4, 0.01, 0, 0]);
    expect(neighbour?.[0]).toBeCloseTo(0.8 + 0.01 * Math.exp(-2) * 0.2, 12);
    expect(neighbour?.[1]).toBeCloseTo(0.01 * Math.exp(-2), 12);
  });

  // The drawn neuron has come to (0.604, 0.01) by then.
  test("neighbours behind it see where it has come to", () => {
    const map = new SelfOrganisingMap([0.6, 0.8], 0.01);
    map.learn(0, [1, 1, 0, 0]);
    const near = Math.exp(-(0.196 ** 2 + 0.01 ** 2) / (2 * 0.1 ** 2));
    expect(map.neurons[1]?.[0]).toBeCloseTo(0.8 + 0.01 * near * 0.2, 12);
  });

  test("the first weights come from chance alone, and are positive", () => {
    const weights = firstWeights(4, 0.97, seeded(7));
    expect(firstWeights(4, 0.97, seeded(7))).toEqual(weights);
    expect(firstWeights(4, 0.97, seeded(8))).not.toEqual(weights);
    expect(Math.min(...weights)).toBeGreaterThan(0);
    expect(Math.max(...weights)).toBeLessThan(1);
  });
});
