import { expect, test } from "vitest";
import { observation } from "#fakes/observation";
import { L2aController } from "./l2a";
import { PAPER_LADDER } from "./ladder";

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
