import { describe, expect, test } from "vitest";
import { InFlightLimit, RequestPace } from "./in-flight-limit";

const AT_60_HZ = { interval: 1000 / 60 };
const FRAME = { render: 10, encode: 2, transmission: 0, alone: false };

function after(overhead: number, options = {}, overtaking = true, clock = AT_60_HZ): InFlightLimit {
  const subject = new InFlightLimit(overtaking, clock);
  for (let now = 0; now < 2000; now += 20) subject.observe({ ...FRAME, overhead, ...options }, now);
  return subject;
}

test("the first request goes alone: it measures the way", () => {
  expect(new InFlightLimit(true, AT_60_HZ).limit).toBe(1);
});

test.each([
  [2, 2],
  [30, 4],
  [100, 8],
  [300, 20],
  [5000, 32],
])("with %i ms outside the server, %i are in flight", (overhead, expected) => {
  expect(after(overhead).limit).toBe(expected);
});

test.each([
  [30, 3],
  [60, 5],
  [120, 8],
  [144, 9],
  [240, 13],
])("a display of %i Hz asks for a view with each of its frames: %i are in flight", (hertz, expected) => {
  expect(after(40, {}, true, { interval: 1000 / hertz }).limit).toBe(expected);
});

test("a display that changes its rate changes the limit", () => {
  const clock = { interval: 1000 / 120 };
  const subject = after(40, {}, true, clock);
  clock.interval = 1000 / 60;
  for (let now = 2000; now < 4000; now += 20) subject.observe({ ...FRAME, overhead: 40 }, now);
  expect(subject.limit).toBe(after(40).limit);
});

test("a slow server gets a few requests to choose the newest from, or no more than it can render in order", () => {
  expect(after(4, { render: 400 }, true).limit).toBe(4);
  expect(after(4, { render: 400 }, false).limit).toBe(2);
});

test.each([
  [20, 0, 3], // the link takes no time, so a request goes out in every animation frame
  [70, 50, 2], // one on the link, and one in transit or being rendered
  [150, 50, 4],
])(
  "with %i ms outside the server, %i of them on the link, %i are in flight: one more would wait",
  (overhead, transmission, expected) => {
    expect(after(overhead, { transmission }).limit).toBe(expected);
  },
);

test("a slow link gets no more frames than it can carry, however long its own queue becomes", () => {
  const subject = new InFlightLimit(true, AT_60_HZ);
  let now = 0;
  subject.observe({ ...FRAME, overhead: 220, transmission: 200, alone: true }, now);
  for (let i = 0; i < 100; i++) {
    now += 200;
    const alone = subject.limit === 1;
    const overhead = alone ? 220 : 20 + subject.limit * 200;
    subject.observe({ ...FRAME, overhead, transmission: 200, alone }, now);
    expect(subject.limit).toBeLessThanOrEqual(2);
  }
});

describe("when the way becomes longer", () => {
  test("the pipeline drains once, measures it, and covers it", () => {
    const subject = after(10);
    const limits: number[] = [];
    for (let now = 2000; now < 9000; now += 50) {
      subject.observe({ ...FRAME, overhead: 200, alone: subject.limit === 1 }, now);
      limits.push(subject.limit);
    }
    expect(limits.filter((limit) => limit === 1)).toHaveLength(1);
    expect(limits.at(-1)).toBe(14);
  });
});

test("when the way becomes shorter, the limit follows at once", () => {
  const subject = after(200);
  subject.observe({ ...FRAME, overhead: 5 }, 2020);
  expect(subject.limit).toBe(3);
});

test("standing still is no reason to forget the way", () => {
  const subject = after(100);
  subject.observe({ ...FRAME, overhead: 100, alone: true }, 600_000);
  expect(subject.limit).toBe(8);
});

describe("request pace", () => {
  const FRAME = 1000 / 60;

  /** Number of requests in a second of animation frames that starts at `from`, in milliseconds. */
  function asked(pace: RequestPace, from: number): number {
    let count = 0;
    for (let i = 0; i < 60; i++) {
      const now = from + i * FRAME;
      if (!pace.allows(now)) continue;
      pace.sent(now);
      count++;
    }
    return count;
  }

  test("asks with every animation frame unless it is told otherwise", () => {
    const pace = new RequestPace();
    expect(asked(pace, 0)).toBe(60);
    pace.told(20);
    asked(pace, 1000);
    pace.told(null);
    expect(asked(pace, 2000)).toBe(60);
  });

  test.each([5, 12.5, 24, 50, 90])("asks %s times a second if told so, on a display with 60 frames", (rate) => {
    const pace = new RequestPace();
    pace.told(rate);
    const count = asked(pace, 0);
    expect(count).toBeGreaterThanOrEqual(Math.min(60, Math.floor(rate)));
    expect(count).toBeLessThanOrEqual(Math.min(60, Math.ceil(rate) + 1));
  });

  test("a pause is not made up for", () => {
    const pace = new RequestPace();
    pace.told(10);
    asked(pace, 0);
    expect(asked(pace, 60_000)).toBeLessThanOrEqual(11);
  });
});
