import { expect, test } from "vitest";
import { observation } from "#fakes/observation";
import { PAPER_LADDER } from "./ladder";
import { seeded } from "./random";
import { CONTROLLER_NAMES, CONTROLLERS } from "./registry";

const HOSTILE = [
  {},
  { throughput: null },
  { throughput: 1 },
  { throughput: 1e12, response: 1 },
  { bytes: 0, response: 0 },
  { profile: 99, bytes: 1 },
  { response: 60_000, server: 0 },
];

test.each(CONTROLLER_NAMES.flatMap((name) => [1, 2, 4, 16].map((rungs) => [name, rungs] as const)))(
  "%s always names a rung of a ladder of %i, whatever it hears",
  (name, rungs) => {
    const ladder = Array.from(
      { length: rungs },
      (_, i) => ({ ...PAPER_LADDER[0], expected_kb: 2 ** (rungs - i) }) as never,
    );
    const subject = CONTROLLERS[name].create({ ladder, random: seeded(3) });
    const random = seeded(4);
    for (let at = 0; at < 4000; at += 10) {
      const told = HOSTILE[Math.floor(random() * HOSTILE.length)] ?? {};
      subject.observe(observation({ ...told, at }));
      const rung = subject.decide(at);
      expect(Number.isInteger(rung) && rung >= 0 && rung < rungs).toBe(true);
    }
  },
);
