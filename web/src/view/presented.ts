/** What is known of a frame that is on the screen, in every mode alike. */

export type Side = "stateless" | "dash" | "webrtc" | "local";

export interface PresentedFrame {
  readonly side: Side;
  /** When it was on the screen, on the page's own clock (performance.now), in milliseconds. */
  readonly at: number;
  /** The number of the pose at which its pixels were asked for. */
  readonly pose: number;
  /** The number of the pose to which the page turned it; left out where it was shown as it came. */
  readonly view?: number;
  /** The estimated share of the picture that the newest frame did not cover; left out where it was not turned. */
  readonly filled?: number;
  /** How long turning it kept the main thread, in milliseconds. */
  readonly warpMs?: number;
  /** Motion-to-photon latency of each pose change that it shows first, in milliseconds. */
  readonly latencies: readonly number[];
  /** The ladder's rung. */
  readonly rung: number | null;
  /** Pixels, as it was encoded. */
  readonly width: number;
  readonly height: number;
  /** Pixels, as it was shown after the page enhanced it; left out where it did not. */
  readonly shownWidth?: number;
  readonly shownHeight?: number;
  /** How long that took the graphics processor, in milliseconds. */
  readonly enhanceMs?: number;
}
