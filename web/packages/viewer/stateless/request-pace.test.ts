import { expect, test } from "vitest";
import { RequestPace } from "./request-pace";

const FRAME = 1000 / 60;

/** Requests in a second of animation frames, from `from` on, in milliseconds. */
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
