import { beforeEach, describe, expect, test } from "vitest";
import courtyard from "../../../../services/render/tigas_render/scenes/demo/ladder.json";
import type { Rung } from "../wire/render";
import { BudgetController } from "./budget";
import { WAYS, type Way } from "./controller";
import { type ObservationOptions, observation } from "./fake-observation";
import { PAPER_LADDER } from "./ladder";
import { seeded } from "./random";

const BYTES = [240_000, 55_000, 20_000, 7000];
const AT_60_HZ = 1000 / 60;
let subject: BudgetController;
let now: number;

beforeEach(() => {
  subject = new BudgetController({ ladder: PAPER_LADDER });
  now = 0;
});

interface Link {
  readonly trip?: number;
  readonly queue?: number;
  /** Milliseconds in the server, by rung. */
  readonly servers?: readonly number[];
  readonly refresh?: number;
  /** Feeds the throughput estimate with frames of a given size on a link of a given rate. */
  readonly read?: (throughput: number, bytes: number) => number;
}

/** Frames for this many milliseconds, one per animation frame: round trip, server and transmission. */
function hear(duration: number, options: ObservationOptions & Link, sizes: readonly number[] = BYTES): number {
  const { trip = 20, queue = 0, throughput = 20e6, servers = [10, 10, 10, 10], refresh = AT_60_HZ, ...rest } = options;
  const { read = (rate) => rate, ...told } = rest;
  for (const until = now + duration; now < until; now += refresh) {
    const profile = subject.decide(now);
    const bytes = told.bytes ?? sizes[profile] ?? 0;
    const server = servers[profile] ?? 0;
    const response = trip + server + queue + (throughput === null ? 0 : (bytes * 8000) / throughput);
    const heard = throughput === null ? null : read(throughput, bytes);
    subject.observe(observation({ profile, server, response, at: now, ...told, bytes, throughput: heard }));
  }
  return subject.decide(now);
}

// Rungs of 7, 20, 55 and 240 kB: a doubling is worth 10 ms, so that a rung up may cost 15, 15 and 21 ms, less 3.
test("it takes a better rung where it costs less time than its picture is worth", () => {
  expect(hear(3000, { throughput: 8e6 })).toBe(3); // 7 → 20 ms on the link, and 3 more between frames
  expect(hear(3000, { throughput: 10e6 })).toBe(2); // 6 → 16
  expect(hear(3000, { throughput: 22e6 })).toBe(2); // 7 → 20, and 3 more between frames
  expect(hear(3000, { throughput: 27e6 })).toBe(1); // 6 → 16
  expect(hear(3000, { throughput: 80e6 })).toBe(1); // 6 → 24, and 7 more between frames
  expect(hear(3000, { throughput: 110e6 })).toBe(0); // 4 → 17
});

test.each([0, 45, 300])("a round trip of %i ms makes no difference: it is the same for all rungs", (trip) => {
  expect(hear(3000, { throughput: 27e6, trip })).toBe(1);
});

test.each([
  { throughput: 100e3, frames: 1 }, // 20 kB take 1.6 s
  { throughput: 1e6, frames: 4 }, // 160 ms
])("it does not wait for five frames that take long: $throughput bit/s, $frames frames", ({ throughput, frames }) => {
  const ladder = PAPER_LADDER.map((rung, i) => ({ ...rung, expected_kb: [240, 55, 11, 7][i] ?? 0 })); // begins with rung 2
  subject = new BudgetController({ ladder });
  const rungs = Array.from({ length: frames }, () => hear(AT_60_HZ, { throughput, bytes: 20_000 }));
  expect(rungs).toEqual([...Array(frames - 1).fill(2), 3]);
});

test("when the link collapses it goes down at once, as far as needed", () => {
  hear(3000, { throughput: 200e6 });
  expect(hear(20, { throughput: 5e6 })).toBe(3);
});

test("frames that wait on the link although none should take it down, whatever the throughput seems to be", () => {
  hear(3000, { throughput: 40e6 });
  expect(subject.decide(now)).toBe(1);
  hear(300, { throughput: 40e6, queue: 80 });
  expect(subject.decide(now)).toBeGreaterThan(1);
});

test("frames that wait although they hardly take the link wait for something else, such as a busy page", () => {
  hear(3000, { throughput: 2000e6 });
  expect(subject.decide(now)).toBe(0);
  hear(300, { throughput: 2000e6, queue: 80 });
  expect(subject.decide(now)).toBe(0);
});

test("an upgrade that had to be taken back makes the next one wait longer", () => {
  const untilUp = () => {
    const start = now;
    while (subject.decide(now) > 1) hear(AT_60_HZ, { throughput: 40e6 });
    return now - start;
  };
  hear(1000, { throughput: 12e6 });
  const first = untilUp();
  hear(120, { throughput: 12e6 });
  expect(untilUp()).toBeGreaterThan(first);
});

test("nothing changes while the throughput is unknown", () => {
  expect(hear(1000, { throughput: null })).toBe(3);
});

describe("in the beginning", () => {
  /** Each rung takes 1.6 times the bytes of the next. */
  const FINE = [138, 92, 56, 36, 23, 14, 9, 6, 4, 2].map((expected_kb, i) => ({
    name: `${i}`,
    width: 1280 - 112 * i,
    height: 720 - 63 * i,
    quality: 80,
    expected_kb,
  }));
  const begin = (throughput: number, trip: number, duration: number) => {
    subject = new BudgetController({ ladder: FINE });
    const asked = [subject.decide(now)];
    for (const until = now + duration; now < until; ) {
      const bytes = (FINE[subject.decide(now)]?.expected_kb ?? 0) * 1000;
      asked.push(hear(AT_60_HZ, { throughput, trip, bytes, servers: FINE.map(() => 10) }));
    }
    return asked;
  };

  test("frames fit into what QUIC sends before it hears of the network", () => {
    const first = begin(20e6, 20, 0).at(-1) ?? 0;
    expect(FINE[first]?.expected_kb).toBeLessThan(14.7 - 1);
    expect(FINE[first - 1]?.expected_kb).toBeGreaterThan(0.8 * 14.7);
  });

  test.each([20, 100])("a good link shows its rung soon, %i ms away", (trip) => {
    expect(begin(200e6, trip, 4 * trip + 350).at(-1)).toBe(0);
  });

  test("bytes grow by at most three times from one rung to the next", () => {
    const sizes = begin(200e6, 20, 500).map((rung) => FINE[rung]?.expected_kb ?? 0);
    for (const [i, size] of sizes.slice(1).entries()) expect(size / (sizes[i] ?? 1)).toBeLessThanOrEqual(3);
  });

  test("a poor link is left at once for what it carries", () => {
    expect(begin(0.5e6, 20, 200).at(-1)).toBe(9);
  });

  test("what had to be taken back ends it: the next upgrade waits", () => {
    begin(200e6, 20, 400);
    hear(200, { throughput: 5e6, bytes: 90_000, servers: [] });
    const low = subject.decide(now);
    expect(low).toBeGreaterThan(0);
    hear(400, { throughput: 200e6, bytes: 9000, servers: [] });
    expect(subject.decide(now)).toBe(low);
  });
});

test("the better the page hides how late a frame is, the more time a picture may take", () => {
  const rungs = (["stale", "rotation", "depth", "predicted"] as const).map((way) => {
    subject = new BudgetController({ ladder: PAPER_LADDER });
    return hear(5000, { throughput: 20e6, way });
  });
  expect(rungs).toEqual(rungs.toSorted((a, b) => b - a));
  expect(rungs.at(-1)).toBeLessThan(rungs[0] ?? 0);
});

describe("a slow renderer", () => {
  const SLOW = [80, 47, 24, 11];

  test("is not asked for pictures that cost more than they are worth", () => {
    expect(hear(5000, { throughput: 500e6, servers: SLOW })).toBe(3);
  });

  test("is not asked for a rung that two others foretell", () => {
    const servers = [80, 30, 10, 5];
    const asked = new Set<number>();
    for (let i = 0; i < 300; i++) asked.add(hear(AT_60_HZ, { throughput: 500e6, servers }));
    expect(asked.has(1)).toBe(true);
    expect(asked.has(0)).toBe(false);
  });

  test("that takes the same for all rungs stops none of them", () => {
    expect(hear(5000, { throughput: 500e6, servers: [40, 40, 40, 40] })).toBe(0);
  });

  describe("with the demo scene's ladder", () => {
    const LADDER: readonly Rung[] = courtyard.rungs;
    const SIZES = LADDER.map(({ expected_kb }) => expected_kb * 1000);
    /** Lines of the picture after 20 s, with a renderer of the given times for an empty frame and for the best rung. */
    const lines = (throughput: number, least: number, best: number, way: Way = "stale") => {
      subject = new BudgetController({ ladder: LADDER });
      const pixels = ({ width, height }: Rung) => (width * height) / (1280 * 720);
      const servers = LADDER.map((rung) => least + (best - least) * pixels(rung));
      return LADDER[hear(20_000, { throughput, servers, way }, SIZES)]?.height ?? 0;
    };

    test.each([
      [24, 200],
      [60, 250],
      [100, 300],
    ])("does not give up the picture for time that no rung saves: %i to %i ms, 100 Mbit/s", (least, best) => {
      for (const way of WAYS) expect(lines(100e6, least, best, way)).toBeGreaterThanOrEqual(270);
    });

    test("is asked for small pictures where those are fast", () => {
      expect(lines(100e6, 0, 300)).toBeLessThanOrEqual(234);
      expect(lines(100e6, 0, 100)).toBeGreaterThan(lines(100e6, 0, 300));
    });

    test.each([1, 60])("gets no large pictures over a thin link: %i ms for any", (server) => {
      expect(lines(1e6, server, server)).toBeLessThanOrEqual(198);
      expect(lines(1e6, server, server)).toBeLessThan(lines(20e6, server, server));
    });
  });
});

test("a display of 120 Hz has less time between frames", () => {
  expect(hear(3000, { throughput: 27e6, refresh: AT_60_HZ })).toBe(1);
  subject = new BudgetController({ ladder: PAPER_LADDER });
  expect(hear(3000, { throughput: 27e6, refresh: AT_60_HZ / 2 })).toBe(2);
});

test("a way that has become longer is taken for a queue no longer than needed", () => {
  hear(3000, { throughput: 27e6 });
  hear(2500, { throughput: 27e6, trip: 120 });
  expect(hear(2500, { throughput: 27e6, trip: 120 })).toBe(1);
});

test.each([4, 10, 15])("jitter of %i ms does not keep it at the lowest rung", (jitter) => {
  const random = seeded(1);
  for (let i = 0; i < 600; i++) {
    const read = (throughput: number, bytes: number) => (bytes * 8000) / ((bytes * 8000) / throughput + 0.7 * jitter);
    hear(AT_60_HZ, { throughput: 40e6, trip: 50 + 2 * jitter * (random() + random()), read });
  }
  expect(subject.decide(now)).toBeLessThan(3);
});

test("small frames that make 24 Mbit/s look like 3 do not keep it at the lowest rung", () => {
  const small = PAPER_LADDER.map((rung) => ({ ...rung, expected_kb: rung.expected_kb / 3.5 }));
  subject = new BudgetController({ ladder: small });
  const read = (throughput: number, bytes: number) => Math.min(throughput, bytes < 3000 ? 3.1e6 : throughput);
  for (let i = 0; i < 300; i++) {
    const bytes = (BYTES[subject.decide(now)] ?? 0) / 3.5;
    hear(AT_60_HZ, { throughput: 24e6, trip: 50, bytes, read });
  }
  expect(subject.decide(now)).toBe(1);
});
