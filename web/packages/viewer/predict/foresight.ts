/** The predicted camera at the time when a frame requested now is on screen. */
import { FrameClock } from "#client/abr/frame-clock";
import { type ScenePose, viewDistance } from "../view/camera";
import type { NumberedPose, Rig } from "../view/rig";
import { Guarded } from "./guarded";
import { LeadTime } from "./lead-time";
import type { Predictor } from "./predictor";
import { createPredictor, type PredictorName } from "./registry";

/** From then on a view may be refined (ms). */
const RESTS_AFTER = 300;

export class Foresight {
  readonly #rig: Rig;
  readonly #chosen: () => PredictorName;
  readonly #lead = new LeadTime();
  readonly #clock = new FrameClock();
  #sampledAt = Number.NEGATIVE_INFINITY;
  /** The last time of a resting camera: its frames may be refinements, which are larger. */
  #rest = { from: 0, until: Number.POSITIVE_INFINITY };
  #name: PredictorName | undefined;
  #predictor: Predictor | undefined;
  /** The rig's, when it was looked at last. */
  #placements = 0;

  constructor(rig: Rig, chosen: () => PredictorName) {
    this.#rig = rig;
    this.#chosen = chosen;
  }

  /** How far ahead it looks, in milliseconds. */
  get ahead(): number {
    return this.#lead.ahead;
  }

  /** Once per animation frame, after the rig was sampled: the pose to ask for. */
  pose(now: number): ScenePose {
    this.#sampledAt = now;
    this.#clock.tick(now);
    this.#follow(now);
    const predictor = this.#current();
    if (this.#rig.placements !== this.#placements) predictor.reset();
    this.#placements = this.#rig.placements;
    predictor.observe(this.#rig.pose, now);
    return predictor.predict(this.ahead);
  }

  /**
   * The pose at which this animation frame is displayed, one display frame later, with the number of the rig's pose.
   * Without a request in this animation frame, it is the rig's pose.
   */
  onScreen(now: number): NumberedPose {
    const { pose } = this.#rig;
    if (now !== this.#sampledAt) return pose;
    return { ...this.#current().predict(this.#clock.interval), seq: pose.seq };
  }

  /** Records that the frame requested at a given time is on screen. */
  shown(askedAt: number, now: number): void {
    const { from, until } = this.#rest;
    if (!this.#lead.known || askedAt < from || askedAt >= until) this.#lead.shown(askedAt, now);
  }

  /** Another connection: how long frames take is not known. */
  reset(): void {
    this.#lead.clear();
    this.#predictor?.reset();
  }

  #follow(now: number): void {
    const rests = now - this.#rig.changedAt > RESTS_AFTER;
    const rested = this.#rest.until === Number.POSITIVE_INFINITY;
    if (rests && !rested) this.#rest = { from: now, until: Number.POSITIVE_INFINITY };
    else if (!rests && rested) this.#rest = { ...this.#rest, until: now };
  }

  #current(): Predictor {
    const name = this.#chosen();
    if (this.#predictor === undefined || name !== this.#name) {
      this.#name = name;
      const distance = () => viewDistance(this.#rig.scene ?? { camera: null });
      this.#predictor = new Guarded(createPredictor(name), distance);
    }
    return this.#predictor;
  }
}
