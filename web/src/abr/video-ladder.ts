/**
 * The ladder of the mode `video`: what a controller chooses from there. Each size of the server's ladder comes at several bit rates,
 * the best first; a size ends where the next smaller one looks better for its bytes. A step is a rung like any other, so controllers
 * that know sizes and bytes of frames serve both modes.
 */
import type { Rung, VideoRequest } from "../wire/render";

/** What a request says of its video. The same object for the same step: views are compared by it. */
export type VideoSetting = Readonly<Required<Omit<VideoRequest, "key">>>;

export interface VideoStep extends Rung {
  /** The rung of the server's ladder that has its size. */
  readonly rung: number;
  readonly video: VideoSetting;
}

/** The bit rate is meant for so many frames a second, so that each takes its share of it, however many come. */
const FRAMES_PER_S = 60;
/** What a frame's pixels get at the steps of one size: from nearly clean to what still looks better than fewer pixels. */
const BITS_A_PIXEL = [0.24, 0.16, 0.11, 0.075];
/** A step has at most such a share of the bytes of the one before. */
const APART = 0.85;

/** The best first, as the server's ladder; none of a ladder without rungs. */
export function videoLadder(ladder: readonly Rung[]): readonly VideoStep[] {
  const steps: VideoStep[] = [];
  for (const [rung, { name, width, height, quality }] of ladder.entries()) {
    if (steps.some((step) => step.width === width && step.height === height)) continue; // the same size, another quality
    for (const bits of BITS_A_PIXEL) {
      const bitrate_kbps = Math.max(10, Math.round((width * height * bits * FRAMES_PER_S) / 1000));
      const least = steps.at(-1)?.video.bitrate_kbps ?? Number.POSITIVE_INFINITY;
      if (bitrate_kbps > APART * least) continue;
      const video = Object.freeze({ bitrate_kbps, frames_per_s: FRAMES_PER_S });
      steps.push({ name, width, height, quality, expected_kb: bitrate_kbps / 8 / FRAMES_PER_S, rung, video });
    }
  }
  return steps;
}

/** The best step of a rung's size that there is, or of the next smaller one: what stands for a rung that a person chose. */
export function stepOfRung(steps: readonly VideoStep[], { width, height }: Pick<Rung, "width" | "height">): number {
  const first = steps.findIndex((step) => step.width * step.height <= width * height);
  return first < 0 ? Math.max(0, steps.length - 1) : first;
}
