import { beforeEach, expect, test } from "vitest";
import { BudgetController } from "./budget";
import { type ObservationOptions, observation } from "./fake-observation";
import { PAPER_LADDER } from "./ladder";

const BYTES = [240_000, 55_000, 20_000, 7000];
let subject: BudgetController;
let now: number;

beforeEach(() => {
  subject = new BudgetController({ ladder: PAPER_LADDER });
  now = 0;
});

/** Frames for so many milliseconds, one each 20: a round trip, 10 ms in the server, and their transmission. */
function hear(
  duration: number,
  { trip = 20, queue = 0, throughput = 20e6, ...told }: ObservationOptions & Trip,
): number {
  for (const until = now + duration; now < until; now += 20) {
    const profile = subject.decide();
    const bytes = BYTES[profile] ?? 0;
    const response = trip + 10 + queue + (throughput === null ? 0 : (bytes * 8000) / throughput);
    subject.observe(observation({ profile, bytes, throughput, response, at: now, ...told }));
  }
  return subject.decide();
}

interface Trip {
  readonly trip?: number;
  readonly queue?: number;
}

test("it takes the best rung whose frames are on the link for less than an animation frame", () => {
  expect(hear(3000, { throughput: 9e6 })).toBe(3);
  expect(hear(3000, { throughput: 20e6 })).toBe(2);
  expect(hear(3000, { throughput: 40e6 })).toBe(1);
  expect(hear(3000, { throughput: 200e6 })).toBe(0);
});

test("a longer round trip leaves less for bytes", () => {
  expect(hear(3000, { throughput: 40e6, trip: 20 })).toBe(1);
  subject = new BudgetController({ ladder: PAPER_LADDER });
  expect(hear(3000, { throughput: 40e6, trip: 45 })).toBe(2);
});

test("where nothing comes in time anyway, small frames win nothing", () => {
  expect(hear(3000, { throughput: 40e6, trip: 300 })).toBe(1);
});

test("when the link collapses it goes down at once, as far as needed", () => {
  hear(3000, { throughput: 200e6 });
  expect(hear(20, { throughput: 5e6 })).toBe(3);
});

test("a queue that fills is left before the throughput tells", () => {
  hear(3000, { throughput: 40e6 });
  expect(subject.decide()).toBe(1);
  for (let queue = 10; queue <= 80; queue += 10) hear(20, { throughput: 40e6, queue });
  expect(subject.decide()).toBeGreaterThan(1);
});

test("an upgrade that had to be taken back makes the next one wait longer", () => {
  const untilUp = () => {
    const start = now;
    while (subject.decide() > 1) hear(20, { throughput: 40e6 });
    return now - start;
  };
  hear(1000, { throughput: 12e6 });
  const first = untilUp();
  hear(40, { throughput: 12e6 });
  expect(untilUp()).toBeGreaterThan(first);
});

test("nothing changes while the throughput is unknown", () => {
  expect(hear(1000, { throughput: null })).toBe(3);
});
