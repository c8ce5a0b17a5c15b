/** Phases and frames of every mode. */

/** State of a mode; `failed` waits for a change of settings. */
export type SourcePhase =
  | { readonly kind: "connecting"; readonly message?: string }
  | { readonly kind: "playing" /** Why the server currently refuses frames. */; readonly problem?: string }
  | { readonly kind: "lost"; readonly message: string }
  | { readonly kind: "failed"; readonly message: string };

export type Side = "stateless" | "dash" | "webrtc" | "local";

/** A frame on the screen. */
export interface PresentedFrame {
  readonly side: Side;
  /** Time when it was on the screen, on the page's own clock (performance.now), in milliseconds. */
  readonly at: number;
  /** Number of the pose at which its pixels were requested. */
  readonly pose: number;
  /** Number of the pose to which the page warped it; absent without a warp. */
  readonly view?: number;
  /** The estimated share of the picture that the newest frame did not cover; absent if it was not turned. */
  readonly filled?: number;
  /** Main thread's time to turn it, in milliseconds. */
  readonly warpMs?: number;
  /** Motion-to-photon latency of each pose change that it shows first, in milliseconds. */
  readonly latencies: readonly number[];
  readonly rung: number | null;
  /** Encoded size in pixels. */
  readonly width: number;
  readonly height: number;
  /** Size in pixels after enhancement; absent without it. */
  readonly shownWidth?: number;
  readonly shownHeight?: number;
  /** Graphics processor's time to enhance it, in milliseconds. */
  readonly enhanceMs?: number;
}
