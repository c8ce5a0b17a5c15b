/** Movements for tests: someone who turns and walks in sines, and what a predictor makes of it. */
import type { ScenePose } from "../view/camera";
import { orientation } from "../view/camera";
import { angleBetween, subtract } from "../view/vector";
import type { Predictor } from "./predictor";

/** After so many milliseconds; `unit` is that of positions in a metre. */
export function sway(at: number, unit = 1): ScenePose {
  const s = at / 1000;
  return {
    position: [unit * 0.4 * Math.sin(1.5 * s), unit * 0.05 * Math.sin(4 * s), unit * 0.6 * Math.sin(s)],
    quaternion: [...orientation(70 * Math.sin(1.3 * s), 15 * Math.sin(1.9 * s))],
  };
}

/** The mean errors, in degrees and in the movement's unit, so far ahead of each sample. */
export function errors(
  predictor: Predictor,
  movement: (at: number) => ScenePose,
  { ahead = 100, rate = 60, jitter = () => 0 }: { ahead?: number; rate?: number; jitter?: () => number },
): { degrees: number; distance: number } {
  let [degrees, distance, count] = [0, 0, 0];
  for (let i = 0; i < 10 * rate; i++) {
    const at = ((i + jitter()) * 1000) / rate;
    predictor.observe(movement(at), at);
    if (at < 500) continue;
    const predicted = predictor.predict(ahead);
    const truth = movement(at + ahead);
    degrees += angleBetween(predicted.quaternion, truth.quaternion);
    distance += Math.hypot(...subtract(predicted.position, truth.position));
    count++;
  }
  return { degrees: degrees / count, distance: distance / count };
}
