/**
 * Joins two sources: the packager reports the pose of each frame of the stream, the browser the time of its
 * presentation. Either may arrive first.
 */
export class FramePoses<Presented> {
  /** Number of frames kept without a match. */
  static readonly KEPT = 1200;
  readonly #poses = new Map<number, number>();
  readonly #waiting = new Map<number, Presented>();
  readonly #matched: (pose: number, presented: Presented) => void;

  constructor(matched: (pose: number, presented: Presented) => void) {
    this.#matched = matched;
  }

  /** Records that frame number `frame` shows pose `pose`. */
  told(frame: number, pose: number): void {
    this.#poses.set(frame, pose);
    forget(this.#poses, frame - FramePoses.KEPT);
    const presented = this.#waiting.get(frame);
    if (presented === undefined) return;
    forget(this.#waiting, frame);
    this.#matched(pose, presented);
  }

  presented(frame: number, presented: Presented): void {
    const pose = this.#poses.get(frame);
    if (pose !== undefined) this.#matched(pose, presented);
    else this.#waiting.set(frame, presented);
    forget(this.#waiting, frame - FramePoses.KEPT);
  }
}

/** Drops frames up to one; numbers may be missing, since a stream that fell behind skips some. */
function forget(frames: Map<number, unknown>, upTo: number): void {
  for (const frame of frames.keys()) if (frame <= upTo) frames.delete(frame);
}
