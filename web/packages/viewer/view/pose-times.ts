/** End times of the camera's last poses, by number, for the age of a picture. Pure: time is an argument. */

/** Poses older than this are forgotten, in milliseconds: no picture of them is looked at any more. */
const SPAN = 10_000;

export class PoseTimes {
  #times: { readonly pose: number; at: number }[] = [];

  /** The camera is at pose number `pose` at a time. */
  sampled(pose: number, at: number): void {
    const last = this.#times.at(-1);
    if (last?.pose === pose) last.at = at;
    else this.#times.push({ pose, at });
    while (this.#times.length > 1 && (this.#times[0]?.at ?? at) < at - SPAN) this.#times.shift();
  }

  /** The page was hidden for the last `gap` milliseconds, which do not count. */
  resumed(gap: number): void {
    for (const time of this.#times) time.at += gap;
  }

  /** For how long the camera has been elsewhere than at this pose, in milliseconds; null if that is not known. */
  age(pose: number, now: number): number | null {
    const time = this.#times.findLast((one) => one.pose <= pose);
    return time === undefined ? null : now - time.at;
  }
}
