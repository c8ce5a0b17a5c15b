/** LoL+ and L2A step by step against dash.js's own; each intended deviation has its own test. */
import { afterEach, describe, expect, test, vi } from "vitest";
import { DashL2a, DashLolp, type Segment } from "#fakes/dashjs-rules";
import { observation } from "#fakes/observation";
import { L2aController } from "./l2a";
import { PAPER_LADDER } from "./ladder";
import { LolpController } from "./lolp";
import { seeded } from "./random";
import { SAFETY, TARGET_LATENCY } from "./segments";

/** Bitrates of the paper's ladder at 60 requests per second, lowest first. */
const RATES = PAPER_LADDER.map(({ expected_kb }) => expected_kb * 1000 * 8 * 60).toReversed();
const LEAST = 20;

afterEach(() => vi.restoreAllMocks());

/** A drifting link and queue, which occasionally jump. */
function* walk(count: number, seed: number, least = 2e6): Generator<{ throughput: number; response: number }> {
  const random = seeded(seed);
  let throughput = 40e6;
  let queue = 10;
  for (let i = 0; i < count; i++) {
    const jump = random() < 0.03;
    throughput = jump ? least * 80 ** random() : throughput * 1.2 ** (random() - 0.5);
    throughput = Math.round(Math.min(150e6, Math.max(least, throughput)) / 10_000) * 10_000;
    queue = Math.min(90, Math.max(0, jump ? 90 * random() : queue + 10 * (random() - 0.5)));
    yield { throughput, response: LEAST + queue };
  }
}

/** A frame of the size in the ladder, so that our bitrates equal those of dash.js. */
function frame(rung: number, throughput: number, response: number) {
  const bytes = (PAPER_LADDER[rung]?.expected_kb ?? 0) * 1000;
  return observation({ profile: rung, bytes, throughput, response });
}

/** The same frame as seen by dash.js, with LEAST as the minimum response. */
function segment(throughput: number, response: number): Segment {
  return { throughput, buffer: TARGET_LATENCY - 0.015 * (response - LEAST), latency: 0.015 * response };
}

/** The greatest difference of two states, relative for values above 1. */
function apart(ours: readonly number[], theirs: readonly number[]): number {
  if (ours.length !== theirs.length) return Number.NaN;
  return Math.max(
    ...theirs.map((value, i) => Math.abs(value - (ours[i] ?? Number.NaN)) / Math.max(1, Math.abs(value))),
  );
}

describe("LoL+", () => {
  const both = async (seed: number) => {
    const ours = new LolpController({ ladder: PAPER_LADDER, random: seeded(seed) });
    const random = seeded(seed);
    vi.spyOn(Math, "random").mockImplementation(random);
    return { ours, theirs: await DashLolp.create(RATES, SAFETY) };
  };
  /** Feeds one frame to both; returns the indices of the bitrates that they choose. */
  const step = ({ ours, theirs }: Awaited<ReturnType<typeof both>>, throughput: number, response: number) => {
    ours.observe(frame(ours.decide(), throughput, response));
    return [RATES.length - 1 - ours.decide(), theirs.segment(segment(throughput, response))] as const;
  };

  test.each([1, 2, 3, 4, 5])("decides and learns as dash.js does, 1000 segments, seed %i", async (seed) => {
    const pair = await both(seed);
    step(pair, 20e6, LEAST);
    const chosen = new Set<number>();
    for (const { throughput, response } of walk(1000, seed)) {
      const [ours, theirs] = step(pair, throughput, response);
      expect(ours).toBe(theirs);
      chosen.add(ours);
      expect(apart(pair.ours.learned.neurons.flat(), pair.theirs.neurons.flat())).toBeLessThan(1e-9);
      if (pair.theirs.weights !== -1) expect(pair.ours.learned.weights).toEqual(pair.theirs.weights);
    }
    expect(chosen.size).toBe(RATES.length);
  });

  test("deviation: the buffer is what the target leaves beyond the least response, not the player's", async () => {
    const near = await both(1);
    const far = new LolpController({ ladder: PAPER_LADDER, random: seeded(1) });
    for (const { throughput, response } of walk(300, 1)) {
      step(near, throughput, response);
      far.observe(frame(far.decide(), throughput, response + 300));
    }
    expect(far.learned.neurons[0]?.[0]).not.toBe(near.ours.learned.neurons[0]?.[0]); // its latencies differ,
    expect(far.learned.neurons[0]?.[0]).toBeCloseTo(near.ours.learned.neurons[0]?.[0] ?? 0, 1); // but not its buffer
  });

  test("deviation: bitrates are those that frames have, not a manifest's", () => {
    const ours = new LolpController({ ladder: PAPER_LADDER, random: seeded(1) });
    for (let i = 0; i < 60; i++) {
      const rung = ours.decide();
      const bytes = (PAPER_LADDER[rung]?.expected_kb ?? 0) * 250;
      ours.observe(observation({ profile: rung, bytes, throughput: 40e6, response: LEAST }));
    }
    expect(ours.decide()).toBe(0); // 28.8 Mbit/s here, and 115.2 by the ladder
  });
});

describe("L2A", () => {
  const both = async (unit: number) => ({
    ours: new L2aController({ ladder: PAPER_LADDER }),
    theirs: await DashL2a.create(RATES, SAFETY, unit),
  });
  const step = ({ ours, theirs }: Awaited<ReturnType<typeof both>>, throughput: number, response: number) => {
    ours.observe(frame(ours.decide(), throughput, response));
    const heard = { ...segment(throughput, response), buffer: TARGET_LATENCY };
    return [RATES.length - 1 - ours.decide(), theirs.segment(heard)] as const;
  };

  test.each([1, 2, 3, 4, 5])(
    "decides and learns as dash.js does with one unit, 1000 segments, seed %i",
    async (seed) => {
      const pair = await both(1000);
      const chosen = new Set<number>();
      for (const { throughput, response } of walk(1000, seed, 4e6)) {
        const [ours, theirs] = step(pair, throughput, response);
        expect(ours).toBe(theirs);
        chosen.add(ours);
        if (pair.theirs.w.length === 0) continue; // start-up
        const { w = [], q = Number.NaN } = pair.ours.learned ?? {};
        expect(apart([...w, q], [...pair.theirs.w, pair.theirs.q])).toBeLessThan(1e-9);
      }
      expect(chosen.size).toBe(RATES.length);
    },
  );

  test("deviation: load is bit/s over bit/s; dash.js has kbit/s below, by which Q grows without end", async () => {
    const pair = await both(1);
    for (let i = 0; i < 100; i++) step(pair, 30e6, LEAST + 1);
    expect(pair.ours.learned?.q).toBeLessThan(10);
    expect(pair.theirs.q).toBeGreaterThan(10_000);
  });

  test("deviation: Q has a bound; dash.js decides nothing any more once it has overflowed", async () => {
    const pair = await both(1000);
    for (let i = 0; i < 1100; i++) step(pair, 2e6, LEAST);
    expect(pair.ours.learned?.q).toBe(1e6);
    expect(pair.theirs.q).toBeNaN();
    let chosen: readonly [number, number] = [0, 0];
    for (let i = 0; i < 10; i++) chosen = step(pair, 40e6, LEAST);
    expect(chosen).toEqual([2, 0]);
  });

  test("deviation: start-up ends with a frame that leaves anything of the target, not with a full buffer", async () => {
    const { ours, theirs } = await both(1000);
    const response = 60;
    ours.observe(frame(3, 20e6, LEAST));
    for (let i = 0; i < 3; i++) theirs.segment(segment(20e6, response));
    expect(theirs.w).toEqual([]);
    ours.observe(frame(3, 20e6, response));
    expect(ours.learned).toBeDefined();
  });
});
