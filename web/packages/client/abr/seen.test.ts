import { beforeEach, expect, test } from "vitest";
import { type ObservationOptions, observation } from "#fakes/observation";
import courtyard from "../../../../services/render/tigas_render/scenes/demo/ladder.json";
import type { Rung } from "../wire/render";
import { PAPER_LADDER } from "./ladder";
import { seeded } from "./random";
import { SeenController } from "./seen";

const LADDER = courtyard.rungs as Rung[];
const AT_60_HZ = 1000 / 60;
let subject: SeenController;
let now: number;

beforeEach(() => {
  subject = new SeenController({ ladder: LADDER });
  now = 0;
});

interface Link {
  readonly trip?: number;
  /** Milliseconds that frames wait on the link. */
  readonly queue?: number;
  /** Milliseconds in the server of a frame of the best rung; others take as much less as they have fewer pixels. */
  readonly server?: number;
  readonly refresh?: number;
  /** Throughput that the page measures with a frame of these bytes, on a link of this rate. */
  readonly measured?: (throughput: number, bytes: number) => number;
}

/** Frames for this many milliseconds, one per animation frame: round trip, server and transmission. */
function hear(duration: number, options: ObservationOptions & Link): number {
  const { trip = 20, queue = 0, throughput = 20e6, server = 10, refresh = AT_60_HZ, ...others } = options;
  const { measured = (rate) => rate, ...rest } = others;
  for (const until = now + duration; now < until; now += refresh) {
    const profile = subject.decide(now);
    const { expected_kb = 0, width = 0, height = 0 } = LADDER[profile] ?? {};
    const bytes = 1000 * expected_kb;
    const rendering = (server * width * height) / (1280 * 720);
    const response = trip + rendering + queue + (throughput === null ? 0 : (bytes * 8000) / throughput);
    subject.observe(
      observation({
        turning: 20,
        way: "predicted",
        server: rendering,
        response,
        at: now,
        ...rest,
        bytes,
        profile,
        throughput: throughput === null ? null : measured(throughput, bytes),
      }),
    );
  }
  return subject.decide(now);
}

test("the faster the link, the better the rung", () => {
  const rungs = [0.5e6, 2e6, 8e6, 30e6, 200e6].map((throughput) => {
    subject = new SeenController({ ladder: LADDER });
    return hear(20_000, { throughput });
  });
  expect(rungs).toEqual(rungs.toSorted((a, b) => b - a));
  expect(rungs[0]).toBeGreaterThan(5);
  expect(rungs.at(-1)).toBeLessThan(2);
});

test("a camera at rest gets sharper pictures than one that turns, which gets newer ones", () => {
  const throughput = 20e6;
  const resting = hear(20_000, { throughput, turning: 0 });
  const turning = hear(20_000, { throughput, turning: 90 });
  expect(turning).toBeGreaterThan(resting);
});

test("the less the page hides the age of frames, the newer they are", () => {
  const rungs = (["predicted", "rotation", "stale"] as const).map((way) => {
    subject = new SeenController({ ladder: LADDER });
    return hear(20_000, { throughput: 10e6, way });
  });
  expect(rungs).toEqual(rungs.toSorted((a, b) => a - b));
  expect(new Set(rungs).size).toBe(3);
});

test("a renderer that takes long for large pictures is not asked for them", () => {
  expect(hear(20_000, { throughput: 200e6, server: 600 })).toBeGreaterThan(2);
});

test.each([200, 300])("a renderer that takes long for every frame, %i ms, does not cost the picture", (server) => {
  expect(LADDER[hear(20_000, { throughput: 100e6, server })]?.height).toBeGreaterThanOrEqual(270);
});

test("when the link collapses it goes down at once, as far as needed", () => {
  hear(20_000, { throughput: 200e6 });
  expect(hear(60, { throughput: 1e6 })).toBeGreaterThan(3);
});

test("frames that wait on the link take it down, whatever the throughput seems to be", () => {
  const before = hear(20_000, { throughput: 20e6, turning: 40 });
  expect(hear(3000, { throughput: 20e6, turning: 40, queue: 400 })).toBeGreaterThan(before);
});

test("a way that has become longer is taken for a queue no longer than needed", () => {
  const before = hear(20_000, { throughput: 20e6 });
  hear(2500, { throughput: 20e6, trip: 120 });
  expect(hear(15_000, { throughput: 20e6, trip: 120 })).toBe(before);
});

test("a link that lets through ten frames a second is slow, however fast the bytes of each come", () => {
  const first = hear(AT_60_HZ, { throughput: 50e6 });
  for (let frame = 0; frame < 600; frame++, now += AT_60_HZ) {
    const profile = subject.decide(now);
    if (frame % 6 > 0) continue;
    const bytes = 1000 * (LADDER[profile]?.expected_kb ?? 0);
    const frames = {
      bytes,
      profile,
      throughput: 50e6,
      server: 5,
      response: 150,
      turning: 20,
      way: "rotation",
    } as const;
    subject.observe(observation({ ...frames, at: now }));
  }
  expect(subject.decide(now)).toBeGreaterThanOrEqual(first - 1);
});

test("a short rise of the throughput changes nothing", () => {
  hear(20_000, { throughput: 4e6 });
  const before = subject.decide(now);
  expect(hear(300, { throughput: 100e6 })).toBe(before);
});

test("it goes up by one rung at a time, and only if the link could carry it even if it were slower", () => {
  hear(20_000, { throughput: 2e6 });
  const rungs: number[] = [];
  for (let i = 0; i < 60; i++) rungs.push(hear(250, { throughput: 60e6 }));
  for (const [i, rung] of rungs.entries()) expect((rungs[i - 1] ?? rung) - rung).toBeLessThanOrEqual(1);
  expect(rungs.at(-1)).toBeLessThan(3);
});

test("an upgrade that had to be taken back makes the next one wait longer", () => {
  const good = hear(20_000, { throughput: 40e6 });
  hear(5000, { throughput: 4e6 });
  const untilUp = () => {
    const start = now;
    const before = subject.decide(now);
    while (subject.decide(now) >= before && now - start < 20_000) hear(AT_60_HZ, { throughput: 40e6 });
    return now - start;
  };
  const first = untilUp();
  hear(300, { throughput: 2e6 });
  expect(untilUp()).toBeGreaterThan(first);
  expect(hear(40_000, { throughput: 40e6 })).toBe(good);
});

test("a display of 120 Hz gets newer frames of a lesser rung", () => {
  const rungs = [AT_60_HZ, AT_60_HZ / 2].map((refresh) => {
    subject = new SeenController({ ladder: LADDER });
    return hear(20_000, { throughput: 15e6, turning: 40, refresh });
  });
  expect(rungs[1]).toBeGreaterThanOrEqual(rungs[0] ?? 0);
});

test.each([4, 10, 15])("jitter of %i ms does not keep it at the lowest rungs", (jitter) => {
  const random = seeded(1);
  const measured = (throughput: number, bytes: number) => (bytes * 8000) / ((bytes * 8000) / throughput + 0.7 * jitter);
  for (let i = 0; i < 1200; i++)
    hear(AT_60_HZ, { throughput: 40e6, trip: 50 + 2 * jitter * (random() + random()), measured });
  expect(subject.decide(now)).toBeLessThan(6);
});

test("small frames that make 24 Mbit/s look like 3 do not keep it at the lowest rungs", () => {
  const measured = (throughput: number, bytes: number) => Math.min(throughput, bytes < 3000 ? 3.1e6 : throughput);
  expect(hear(20_000, { throughput: 24e6, trip: 50, measured })).toBeLessThan(5);
});

test("on a link that wavers it changes less than ten times a minute", () => {
  let changes = 0;
  let last = hear(10_000, { throughput: 10e6 });
  for (let i = 0; i < 120; i++) {
    const rung = hear(500, { throughput: i % 2 === 0 ? 8e6 : 12e6 });
    if (rung !== last) changes++;
    last = rung;
  }
  expect(changes).toBeLessThan(10);
});

test("on a link that breaks down every twenty seconds it changes less than twelve times a minute", () => {
  let changes = 0;
  let last = hear(10_000, { throughput: 60e6 });
  for (let tick = 0; tick < 1200; tick++) {
    const rung = hear(50, { throughput: tick % 400 < 10 ? 1e6 : 60e6 });
    if (rung !== last) changes++;
    last = rung;
  }
  expect(changes).toBeLessThan(12);
});

test("a short dip of the throughput changes nothing", () => {
  const before = hear(20_000, { throughput: 20e6, turning: 90 });
  expect(hear(1500, { throughput: 6e6, turning: 90 })).toBe(before);
});

test("after a collapse of the link it goes back to its rung in one step", () => {
  const before = hear(20_000, { throughput: 60e6 });
  hear(500, { throughput: 1e6 });
  const rungs = new Set<number>();
  for (let i = 0; i < 200; i++) rungs.add(hear(50, { throughput: 60e6 }));
  expect(rungs.size).toBeLessThanOrEqual(3);
  expect([...rungs].at(-1)).toBe(before);
});

test("it begins with frames that fit into one round trip, and is at a good rung within a second", () => {
  expect(LADDER[subject.decide(0)]?.expected_kb).toBeLessThan(12);
  expect(hear(1000, { throughput: 100e6 })).toBeLessThan(3);
});

test("without a known throughput it stays", () => {
  const before = subject.decide(now);
  expect(hear(3000, { throughput: null })).toBe(before);
});

test("a ladder without measured quality, and one of a single rung, will do", () => {
  const paper = new SeenController({ ladder: PAPER_LADDER });
  for (let i = 0; i < 1000; i++) {
    const profile = paper.decide(i * AT_60_HZ);
    const bytes = 1000 * (PAPER_LADDER[profile]?.expected_kb ?? 0);
    paper.observe(observation({ profile, bytes, throughput: 200e6, response: 30, way: "predicted", at: i * AT_60_HZ }));
  }
  expect(paper.decide(20_000)).toBe(0);
  const only = new SeenController({ ladder: PAPER_LADDER.slice(0, 1) });
  only.observe(observation({ profile: 0, bytes: 240_000, throughput: 1e6 }));
  expect(only.decide(1)).toBe(0);
});
