/** The predicted camera at the time when a frame requested now will be on the screen. */
import { FrameClock } from "#client/abr/frame-clock";
import { median } from "../enhance/median";
import { isCut, type ScenePose, viewDistance } from "../view/camera";
import { type NumberedPose, type Rig, samePose } from "../view/rig";
import { PoseHistory, type Predict } from "./pose-history";
import { PREDICTORS, type PredictorName } from "./registry";

/*
 * Prediction horizon of requests: the recent time from request to screen, plus half the time until the next frame
 * replaces it. Pure: time is an argument, in milliseconds on one clock.
 */

/** Number of frames averaged: few enough to follow the network, enough to ignore a late one. */
const FRAMES = 15;
/** No pose is predicted farther ahead than this. */
const LONGEST = 500;
/** A frame that stays longer has no successor: the camera rests. */
const LONGEST_STAY = 250;

export class LeadTime {
  #delays: number[] = [];
  #stays: number[] = [];
  #shownAt: number | undefined;
  #askedAt = Number.NEGATIVE_INFINITY;

  /** Records that a frame requested at a given time is on the screen; repeats (a video at rest) are ignored. */
  shown(askedAt: number, at: number): void {
    if (askedAt <= this.#askedAt) return;
    this.#askedAt = askedAt;
    this.#delays = [...this.#delays, at - askedAt].slice(-FRAMES);
    const stay = at - (this.#shownAt ?? Number.NEGATIVE_INFINITY);
    if (stay <= LONGEST_STAY) this.#stays = [...this.#stays, stay].slice(-FRAMES);
    this.#shownAt = at;
  }

  /** Whether any frame was shown. */
  get known(): boolean {
    return this.#delays.length > 0;
  }

  /** The horizon in milliseconds; 0 until a frame was shown. */
  get ahead(): number {
    return Math.min(LONGEST, Math.max(0, (median(this.#delays) || 0) + (median(this.#stays) || 0) / 2));
  }

  /** Resets the estimate, for a new connection. */
  clear(): void {
    this.#delays = [];
    this.#stays = [];
    this.#shownAt = undefined;
    this.#askedAt = Number.NEGATIVE_INFINITY;
  }
}

/** A camera without movement for this many milliseconds rests. */
const STILL_AFTER = 200;

/**
 * Predicts the camera's pose: restarts after a cut, always answers with a valid pose, and with exactly the camera's pose
 * when it rests, so that a still view settles.
 */
export class Predictor {
  readonly #history = new PoseHistory();
  readonly #predict: Predict;
  readonly #distance: () => number;
  #at = 0;
  #changedAt = Number.NEGATIVE_INFINITY;

  /** `distance` is that of the focus, in scene units. */
  constructor(predict: Predict, distance: () => number) {
    this.#predict = predict;
    this.#distance = distance;
  }

  /** Records the camera's pose at a time, once per animation frame. */
  observe(pose: ScenePose, at: number): void {
    if (!isSound(pose) || !Number.isFinite(at)) return;
    const { last, empty } = this.#history;
    if (empty || at < this.#at || isCut(last, pose, this.#distance())) this.reset();
    else if (!samePose(last, pose)) this.#changedAt = at;
    this.#at = at;
    this.#history.add(pose, at);
  }

  /** The pose at this time after the last observation. The call has no side effects. */
  predict(ahead: number): ScenePose {
    const { last, empty } = this.#history;
    if (empty || !(ahead > 0) || this.#at - this.#changedAt > STILL_AFTER) return last;
    const predicted = this.#predict(this.#history, ahead);
    if (samePose(predicted, last)) return last;
    const sound = { ...predicted, quaternion: normalised(predicted.quaternion) };
    return isSound(sound) ? sound : last;
  }

  /** Discards the history. */
  reset(): void {
    this.#changedAt = Number.NEGATIVE_INFINITY;
    this.#history.clear();
  }
}

function isSound({ position, quaternion }: ScenePose): boolean {
  return position.every(Number.isFinite) && quaternion.every(Number.isFinite);
}

function normalised([x, y, z, w]: ScenePose["quaternion"]): ScenePose["quaternion"] {
  const length = Math.hypot(x, y, z, w);
  return [x / length, y / length, z / length, w / length];
}

/** A view may be refined after resting this long (ms). */
const RESTS_AFTER = 300;

export class Foresight {
  readonly #rig: Rig;
  readonly #chosen: () => PredictorName;
  readonly #lead = new LeadTime();
  readonly #clock = new FrameClock();
  #sampledAt = Number.NEGATIVE_INFINITY;
  /** The last time span of a resting camera, in which frames may be refinements, which are larger. */
  #rest = { from: 0, until: Number.POSITIVE_INFINITY };
  #name: PredictorName | undefined;
  #predictor: Predictor | undefined;
  /** The rig's number of placements when it was last checked. */
  #placements = 0;

  constructor(rig: Rig, chosen: () => PredictorName) {
    this.#rig = rig;
    this.#chosen = chosen;
  }

  /** How far ahead it looks, in milliseconds. */
  get ahead(): number {
    return this.#lead.ahead;
  }

  /** Called once per animation frame, after the rig was sampled: the pose to request. */
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

  /** Records that the frame requested at a given time is on the screen. */
  shown(askedAt: number, now: number): void {
    const { from, until } = this.#rest;
    if (!this.#lead.known || askedAt < from || askedAt >= until) this.#lead.shown(askedAt, now);
  }

  /** Resets the lead time, which is unknown for a new connection. */
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
      this.#predictor = new Predictor(PREDICTORS[name].predict, distance);
    }
    return this.#predictor;
  }
}
