import { expect, test } from "vitest";
import { observation } from "#fakes/observation";
import { initialState, L2aController, projectToSimplex, step } from "./l2a";
import { PAPER_LADDER } from "./ladder";

// Worked by hand from the published update: horizon 4, VL = 4^0.99, alpha = 2 VL, a segment of 0.5 s, so that the first
// step's gain V / (2 alpha) * (Q + VL) is exactly 0.25.
const VL = 4 ** 0.99;

test("a step on a link that carries all bitrates", () => {
  const { w, q, choice } = step(initialState(2, 0), [1, 2], 4);
  // load 0.25 and 0.5: w = project(1 + 0.0625, 0 + 0.125)
  expect(w[0]).toBeCloseTo(0.96875, 12);
  expect(w[1]).toBeCloseTo(0.03125, 12);
  // Q = VL - 0.5 + 0.5 (load w + load change) = VL - 0.5 + 0.5 (0.2578125 + 0.0078125)
  expect(q).toBeCloseTo(VL - 0.3671875, 12);
  expect(choice).toBe(0);
});

test("a step on a link that does not carry the bitrate in use: its probability falls, and Q reacts", () => {
  const { w, q, choice } = step(initialState(2, 1), [1, 2], 1);
  // load 1 and 2: w = project(0 + 0.25, 1 - 0.5); Q = VL - 0.5 + 0.5 (1.625 - 0.375), then twice that
  expect(w[0]).toBeCloseTo(0.375, 12);
  expect(w[1]).toBeCloseTo(0.625, 12);
  expect(q).toBeCloseTo(2 * (VL + 0.125), 12);
  expect(choice).toBe(1);
});

test("it goes up one bitrate at a time", () => {
  const before = { w: [0, 0, 0, 1], q: VL, choice: 0 };
  expect(step(before, [1, 2, 3, 4], 10).choice).toBe(1);
});

test("starts by throughput, and leaves what the link does not carry", () => {
  const subject = new L2aController({ ladder: PAPER_LADDER });
  subject.observe(observation({ throughput: null }));
  expect(subject.decide()).toBe(3);
  // At 60 requests/s the rungs take 3.36, 9.6, 26.4 and 115.2 Mbit/s; 0.9 of 40 Mbit/s carry 26.4.
  subject.observe(observation({ throughput: 40e6 }));
  expect(subject.decide()).toBe(1);
  for (let i = 0; i < 40; i++) subject.observe(observation({ profile: 1, bytes: 55_000, throughput: 6e6 }));
  expect(subject.decide()).toBe(3);
});

test.each([
  [
    [0.5, 0.5],
    [0.5, 0.5],
  ],
  [
    [2, 0],
    [1, 0],
  ],
  [
    [1.0625, 0.125],
    [0.96875, 0.03125],
  ],
  [
    [0.2, 0.2, 0.2],
    [1 / 3, 1 / 3, 1 / 3],
  ],
  [
    [-3, 0.1, 0.4],
    [0, 0.35, 0.65],
  ],
  [[-5], [1]],
])("%j becomes %j", (point, expected) => {
  const projected = projectToSimplex(point);
  for (const [i, value] of expected.entries()) expect(projected[i]).toBeCloseTo(value, 12);
});
