import { expect, test } from "vitest";
import { bestWeights, downloadTime, nextBuffer, qoe } from "./lolp-qoe";

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
