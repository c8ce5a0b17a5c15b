import { expect, test } from "vitest";
import { normal, seeded } from "#client/abr/random";
import { bootstrap } from "./bootstrap";

test("values that are all the same leave no doubt", () => {
  expect(bootstrap([2, 2, 2], seeded(1))).toEqual({ mean: 2, low: 2, high: 2 });
});

test("of many values the interval is that of the normal distribution", () => {
  const random = seeded(1);
  const values = Array.from({ length: 400 }, () => 5 + normal(random));
  const { mean, low, high } = bootstrap(values, seeded(2));
  expect(mean).toBeCloseTo(5, 0);
  expect((high - low) / 2).toBeCloseTo(1.96 / 20, 1);
  expect(low < mean && mean < high).toBe(true);
});

test("the same chance gives the same interval", () => {
  expect(bootstrap([1, 2, 5, 9], seeded(1))).toEqual(bootstrap([1, 2, 5, 9], seeded(1)));
});
