/**
 * What the viewer records during a run. `services/lab/tigas_lab/recording.py` reads it; all times are milliseconds since the
 * run's start. Pure: time comes in with what is recorded.
 */
import type { PresentedFrame } from "../player/presented";
import type { NumberedPose } from "../player/rig";

/** A pose that the rig sampled, because it differs from the one before. */
export interface RecordedInput {
  readonly at: number;
  readonly pose: number;
  readonly position: readonly number[];
  readonly quaternion: readonly number[];
}

/** A frame whose picture was kept. */
export interface RecordedCapture {
  readonly at: number;
  readonly pose: number;
  readonly rung: number | null;
  readonly width: number;
  readonly height: number;
}

/** What had been received by then, in bytes since the run's start. */
export interface RecordedTraffic {
  readonly at: number;
  readonly bytes: number;
}

export interface Records {
  readonly inputs: readonly RecordedInput[];
  readonly frames: readonly PresentedFrame[];
  readonly captures: readonly RecordedCapture[];
  readonly traffic: readonly RecordedTraffic[];
}

export class Recorder {
  /** On the page's clock. */
  readonly startedAt: number;
  readonly #captureEvery: number;
  readonly #inputs: RecordedInput[] = [];
  readonly #frames: PresentedFrame[] = [];
  readonly #captures: RecordedCapture[] = [];
  readonly #traffic: RecordedTraffic[] = [];
  #pose: number;
  #shown: number;
  #received: number;
  #captureAt: number;

  /** `pose` is on the screen when the run starts, and `received` bytes have come in; `captureEvery` 0 keeps no picture. */
  constructor(startedAt: number, pose: number, received: number, captureEvery: number) {
    this.startedAt = startedAt;
    this.#pose = pose;
    this.#shown = pose;
    this.#received = received;
    this.#captureEvery = captureEvery;
    this.#captureAt = captureEvery; // the first picture is that of a camera that moves
  }

  /** The rig stands at `pose` since a time. */
  sampled({ seq, position, quaternion }: NumberedPose, at: number): void {
    if (seq === this.#pose) return;
    this.#pose = seq;
    this.#inputs.push({ at: at - this.startedAt, pose: seq, position, quaternion });
  }

  /** A frame is on the screen. Returns whether its picture is to be kept. */
  presented(frame: PresentedFrame): boolean {
    const at = frame.at - this.startedAt;
    if (at < 0) return false;
    this.#frames.push({ ...frame, at });
    this.#shown = Math.max(this.#shown, frame.pose);
    if (this.#captureEvery === 0 || at < this.#captureAt) return false;
    this.#captureAt = (Math.floor(at / this.#captureEvery) + 1) * this.#captureEvery;
    return true;
  }

  /** The picture of a frame was kept. */
  captured({ at, pose, rung }: PresentedFrame, picture: { readonly width: number; readonly height: number }): void {
    const { width, height } = picture;
    this.#captures.push({ at: at - this.startedAt, pose, rung, width, height });
  }

  /** So many bytes have come in since the page was opened. */
  received(bytes: number, at: number): void {
    this.#traffic.push({ at: at - this.startedAt, bytes: bytes - this.#received });
  }

  /** The newest pose is on the screen. */
  get settled(): boolean {
    return this.#shown >= this.#pose;
  }

  /** Everything, in the order of time: a video's frames are told of when they are decoded, not when they are shown. */
  get records(): Records {
    return {
      inputs: this.#inputs,
      frames: this.#frames.toSorted((a, b) => a.at - b.at),
      captures: this.#captures,
      traffic: this.#traffic,
    };
  }
}
