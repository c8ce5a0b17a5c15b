/** The person's own input where a person steers, and what was learned of people's heads where a source drives the camera. */
import type { ScenePose } from "../view/camera";
import { Input } from "./input";
import { Linear } from "./linear";
import type { Predictor, PredictorContext } from "./predictor";

export class Auto implements Predictor {
  readonly #rig: PredictorContext["rig"];
  readonly #input: Input;
  readonly #linear = new Linear();

  constructor(context: PredictorContext) {
    this.#rig = context.rig;
    this.#input = new Input(context);
  }

  observe(pose: ScenePose, at: number): void {
    this.#input.observe(pose, at);
    this.#linear.observe(pose, at);
  }

  predict(ahead: number): ScenePose {
    const driven = this.#rig.source.peek() !== null;
    return driven ? this.#linear.predict(ahead) : this.#input.predict(ahead);
  }

  reset(): void {
    this.#input.reset();
    this.#linear.reset();
  }
}
