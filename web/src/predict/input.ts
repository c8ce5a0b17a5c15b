/**
 * Where the person's own keys and pointer take the camera: keys stay as they are, which is exact until one goes up or down, and
 * what is dragged or glides comes to rest. Where a source drives the camera it stays where it is.
 */
import type { ScenePose } from "../view/camera";
import { NO_NUDGE, type Nudge } from "../view/motion";
import { NOWHERE, type Predictor, type PredictorContext } from "./predictor";

/** How fast a pointer goes is measured over so many milliseconds: pointers do not report with every animation frame. */
const PACE_SPAN = 34;
/**
 * A drag slows down as e^(-t/200 ms), which foretells minimum-jerk movements of 0.2 to 1.5 s best, and a wheel as `Glide` does: that
 * is nearly all that ever nudges the camera forward (ms).
 */
const DRAGGED = 200;
const GLIDING = 60;

interface Moment {
  readonly nudge: Nudge;
  readonly elapsed: number;
  readonly at: number;
}

export class Input implements Predictor {
  readonly #rig: PredictorContext["rig"];
  #pose = NOWHERE;
  #recent: Moment[] = [];

  constructor({ rig }: PredictorContext) {
    this.#rig = rig;
  }

  observe(pose: ScenePose, at: number): void {
    const before = this.#recent.at(-1)?.at ?? at;
    this.#recent = this.#recent.filter((moment) => moment.at > at - PACE_SPAN);
    this.#recent.push({ nudge: this.#rig.input.nudge, elapsed: at - before, at });
    this.#pose = pose;
  }

  predict(ahead: number): ScenePose {
    if (this.#rig.source.peek() !== null) return this.#pose;
    const nudge = this.#coming(ahead);
    return this.#rig.foresee({ axes: this.#rig.input.axes, nudge }, ahead);
  }

  reset(): void {
    this.#recent = [];
  }

  /** What pointers, fingers and the wheel will ask for in that time. */
  #coming(ahead: number): Nudge {
    const span = this.#recent.reduce((sum, { elapsed }) => sum + elapsed, 0);
    if (span <= 0) return NO_NUDGE;
    const pace = (part: keyof Nudge) => this.#recent.reduce((sum, { nudge }) => sum + nudge[part], 0) / span;
    const dragged = slowing(ahead, DRAGGED);
    return {
      turnRight: pace("turnRight") * dragged,
      turnUp: pace("turnUp") * dragged,
      orbitRight: pace("orbitRight") * dragged,
      orbitUp: pace("orbitUp") * dragged,
      forward: pace("forward") * slowing(ahead, GLIDING),
      right: pace("right") * dragged,
      up: pace("up") * dragged,
    };
  }
}

/** How far something gets that slows down with a time constant, as the time in which it would go as far at its first speed. */
function slowing(time: number, constant: number): number {
  return constant * (1 - Math.exp(-time / constant));
}
