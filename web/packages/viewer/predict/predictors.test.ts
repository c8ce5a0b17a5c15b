/** Properties of every predictor of the registry. */

import fc from "fast-check";
import { beforeAll, describe, expect, test } from "vitest";
import { seeded } from "#client/abr/random";
import { EFFORT } from "#fakes/effort";
import { orientation, type ScenePose } from "../view/camera";
import { angleBetween, subtract } from "../view/vector";
import { Predictor } from "./foresight";
import { loadCoefficients } from "./linear";
import { PREDICTOR_NAMES, PREDICTORS, type PredictorName } from "./registry";

beforeAll(loadCoefficients);

/** Predictors that extrapolate movement. */
const MOVING = PREDICTOR_NAMES.filter((name) => name !== "off");

function make(name: PredictorName, distance = 4): Predictor {
  return new Predictor(PREDICTORS[name].predict, () => distance);
}

/**
 * A user who turns and walks in sines, after this many milliseconds; `unit` is the number of position units in a metre.
 */
function sway(at: number, unit = 1): ScenePose {
  const s = at / 1000;
  return {
    position: [unit * 0.4 * Math.sin(1.5 * s), unit * 0.05 * Math.sin(4 * s), unit * 0.6 * Math.sin(s)],
    quaternion: [...orientation(70 * Math.sin(1.3 * s), 15 * Math.sin(1.9 * s))],
  };
}

/** The mean errors of ten seconds, 100 ms ahead: in degrees, and in the movement's unit. */
function errors(
  predictor: Predictor,
  { movement = (at: number) => sway(at), rate = 60, jitter = (): number => 0 } = {},
): { degrees: number; distance: number } {
  let [degrees, distance, count] = [0, 0, 0];
  for (let i = 0; i < 10 * rate; i++) {
    const at = ((i + jitter()) * 1000) / rate;
    predictor.observe(movement(at), at);
    if (at < 500) continue;
    const predicted = predictor.predict(100);
    const truth = movement(at + 100);
    degrees += angleBetween(predicted.quaternion, truth.quaternion);
    distance += Math.hypot(...subtract(predicted.position, truth.position));
    count++;
  }
  return { degrees: degrees / count, distance: distance / count };
}

test.each(PREDICTOR_NAMES)("%s answers with a pose, whatever it sees", (name) => {
  const time = fc.oneof(
    fc.double({ min: -50, max: 1e6 }),
    fc.constantFrom(0, 16, 16, 17, 1e-9, 1e12, Number.NaN, Number.POSITIVE_INFINITY),
  );
  const number = fc.oneof(fc.double(), fc.double({ min: -1, max: 1 }), fc.constantFrom(0, 1, -1, 1e-300, 1e300));
  const sample = fc.record({
    position: fc.tuple(number, number, number),
    quaternion: fc.tuple(number, number, number, number),
    step: time,
  });
  const ahead = fc.oneof(fc.double(), fc.double({ min: 0, max: 600 }));
  fc.assert(
    fc.property(fc.array(sample, { maxLength: 20 }), ahead, (samples, ahead) => {
      const predictor = make(name, Number.POSITIVE_INFINITY);
      let at = 0;
      for (const { step, ...pose } of samples) {
        at += Number.isFinite(step) ? step : 0;
        predictor.observe(pose, Number.isFinite(step) ? at : step);
        const { position, quaternion } = predictor.predict(ahead);
        expect([...position, ...quaternion].every(Number.isFinite)).toBe(true);
      }
    }),
    EFFORT,
  );
});

describe.each(MOVING)("%s", (name) => {
  test.each([30, 60, 120])("foresees at %d Hz, at irregular times, too, far better than nothing does", (rate) => {
    const random = seeded(1);
    const none = errors(make("off"), { rate });
    for (const jitter of [() => 0, () => random() * 0.8]) {
      const { degrees, distance } = errors(make(name), { rate, jitter });
      expect(degrees).toBeLessThan(none.degrees / 3);
      expect(distance).toBeLessThan(none.distance / 3);
    }
  });

  test("does not mind a rotation's negative twin", () => {
    let negative = false;
    const movement = (at: number): ScenePose => {
      const { position, quaternion } = sway(at);
      negative = !negative;
      const sign = negative ? -1 : 1;
      const [x, y, z, w] = quaternion;
      return { position, quaternion: [sign * x, sign * y, sign * z, sign * w] };
    };
    expect(errors(make(name), { movement }).degrees).toBeCloseTo(errors(make(name)).degrees, 6);
  });

  test("does the same in a scene of any unit", () => {
    const metres = errors(make(name));
    const other = errors(make(name, 4000), { movement: (at) => sway(at, 1000) });
    expect(other.distance / 1000).toBeCloseTo(metres.distance, 9);
    expect(other.degrees).toBeCloseTo(metres.degrees, 9);
  });

  test("ends where the camera ends, within 200 ms", () => {
    const predictor = make(name);
    const stopping = (at: number) => sway(Math.min(at, 700));
    for (let at = 0; at <= 920; at += 10) predictor.observe(stopping(at), at);
    expect(predictor.predict(200)).toEqual(stopping(920));
  });

  test("goes the farther the farther it looks, without a jump", () => {
    const predictor = make(name);
    for (let at = 0; at <= 500; at += 10) predictor.observe(sway(at), at);
    let before = predictor.predict(1);
    for (let ahead = 2; ahead < 450; ahead++) {
      const after = predictor.predict(ahead);
      expect(angleBetween(after.quaternion, before.quaternion)).toBeLessThan(0.2);
      expect(Math.hypot(...subtract(after.position, before.position))).toBeLessThan(0.002);
      before = after;
    }
    expect(angleBetween(before.quaternion, sway(500).quaternion)).toBeGreaterThan(5);
  });
});
