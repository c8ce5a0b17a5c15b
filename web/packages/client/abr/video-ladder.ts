/**
 * The ladder of the mode `video`. Its steps are bit rates, each with the largest size of the server's ladder whose
 * pixels get enough bits. A step is a rung like any other, so controllers that know sizes and bytes of frames serve
 * both modes.
 */
import type { Rung, VideoRequest } from "../wire/render";
import { decibels, seenOfRung } from "./seen-error";

/** The video parameters of a request. The same object for the same step, because views are compared by identity. */
export type VideoSetting = Readonly<Required<Omit<VideoRequest, "key">>>;

export interface VideoStep extends Rung {
  /** The rung of the server's ladder that has its size. */
  readonly rung: number;
  readonly video: VideoSetting;
}

/** Frame rate assumed by the bit rate; each frame gets its share at any actual frame rate. */
const FRAMES_PER_S = 60;
/** Bits per pixel of the largest size at the best step: more gains little, even where few frames arrive and each shows much that is new. */
const BEST = 0.16;
/** Bits per pixel below which a size gives way to the next smaller one: about a JPEG of quality 35 (docs/adaptation.md); also the last step's. */
const LEAST = 0.04;
/** Each step's bytes as a share of the previous step's. */
const APART = 0.7;
/** Ratio of the bytes of a JPEG with the same error (docs/results/2026-11-video.md). */
const JPEG = 7;
/** The lowest rate that the server accepts, in kbit/s. */
const LOWEST = 10;

/** Steps, best first, with the sizes of the server's ladder from rung `first` on; empty without rungs. */
export function videoLadder(ladder: readonly Rung[], first = 0): readonly VideoStep[] {
  const rungs = ladder.map((size, rung) => ({ ...size, rung, pixels: size.width * size.height }));
  const sizes = rungs.slice(first);
  const each = sizes.filter(({ pixels }, i) => sizes.findIndex((other) => other.pixels === pixels) === i); // its best rung
  const [largest, ...smaller] = each.toSorted((a, b) => b.pixels - a.pixels);
  if (largest === undefined) return [];
  const smallest = smaller.at(-1) ?? largest;
  const steps: VideoStep[] = [];
  for (let bits = BEST * largest.pixels; bits >= LEAST * smallest.pixels; bits *= APART) {
    const { pixels: _, ...size } = [largest, ...smaller].find(({ pixels }) => LEAST * pixels <= bits) ?? smallest;
    const bitrate_kbps = Math.max(LOWEST, Math.round((bits * FRAMES_PER_S) / 1000));
    const video = Object.freeze({ bitrate_kbps, frames_per_s: FRAMES_PER_S });
    const expected_kb = bitrate_kbps / 8 / FRAMES_PER_S;
    const psnr_db = decibels(seenOfRung({ expected_kb: JPEG * expected_kb }).mse);
    steps.push({ ...size, expected_kb, psnr_db, video });
    if (bitrate_kbps === LOWEST) break;
  }
  return steps;
}

/** The single step for a given bit rate, with the size that the ladder has for it; none without rungs. */
export function stepOfBitrate(ladder: readonly Rung[], bitrate_kbps: number): readonly VideoStep[] {
  const steps = videoLadder(ladder);
  const like = steps.find(({ video }) => video.bitrate_kbps <= bitrate_kbps) ?? steps.at(-1);
  if (like === undefined) return [];
  const video = Object.freeze({ ...like.video, bitrate_kbps });
  return [{ ...like, expected_kb: bitrate_kbps / 8 / FRAMES_PER_S, video }];
}

/** The best step of a rung's size, or of the next smaller one: stands in for a rung chosen by the user. */
export function stepOfRung(steps: readonly VideoStep[], { width, height }: Pick<Rung, "width" | "height">): number {
  const first = steps.findIndex((step) => step.width * step.height <= width * height);
  return first < 0 ? Math.max(0, steps.length - 1) : first;
}
