import { expect, test } from "vitest";
import { distance, firstWeights, SelfOrganisingMap } from "./lolp-som";
import { seeded } from "./random";

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
