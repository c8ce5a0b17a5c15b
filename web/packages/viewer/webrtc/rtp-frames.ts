/** Numbers a video's frames by their RTP timestamps, which count 90,000 a second and begin anew after 2³²: 13 hours. */

const RATE = 90_000;

export class RtpFrames {
  readonly #ticks: number;
  /** The newest timestamp seen, and the number of its frame. */
  #newest: { readonly timestamp: number; readonly frame: number } | null = null;

  constructor(frameRate: number) {
    this.#ticks = RATE / frameRate;
  }

  /** The number of the frame with this timestamp; the first one gets an arbitrary number. */
  number(timestamp: number): number {
    const newest = this.#newest ?? { timestamp, frame: 0 };
    const ahead = (timestamp - newest.timestamp) | 0; // modulo 2³², between -2³¹ and 2³¹
    const frame = newest.frame + Math.round(ahead / this.#ticks);
    if (ahead >= 0) this.#newest = { timestamp, frame };
    return frame;
  }
}
