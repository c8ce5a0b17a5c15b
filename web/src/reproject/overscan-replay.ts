/** How much of the view frames of an age would leave uncovered, over a recorded movement: what auto overscan is tuned and measured by. */
import type { TimedPose } from "../movement/playback";
import { recorded } from "../predict/courses";
import { predictions } from "../predict/evaluate";
import type { PredictorName } from "../predict/registry";
import type { Quaternion } from "../view/vector";
import { uncoveredShare } from "./coverage";
import { AutoOverscan } from "./overscan";
import { type View, viewOfFrame } from "./view";

export interface Replay {
  /** How old frames are when they are seen, in milliseconds. */
  readonly age: number;
  readonly predictor: PredictorName;
  /** The share of the viewport to ask for at each side. */
  readonly overscan: number | "auto";
}

export interface Coverage {
  /** Mean share of the view that the newest frame does not cover, before anything older fills it. */
  readonly uncovered: number;
  /** Pixels of frames at the same pixels per angle; 1 without overscan. */
  readonly pixels: number;
}

/** Animation frames a second, each of which asks for one. */
const RATE = 60;
const SIZE = { width: 1280, height: 720 };
/** A vertical field of view of 60 degrees. */
const FOCAL = SIZE.height / 2 / Math.tan(Math.PI / 6);

/** Everything counts as infinitely far: only how the movement turns matters. */
export function replay(points: readonly TimedPose[], { age, predictor, overscan }: Replay): Coverage {
  const late = Math.round((age * RATE) / 1000);
  const { said, seen } = predictions(recorded(points, RATE), predictor, [age]);
  const auto = new AutoOverscan();
  const asked: { readonly view: View; readonly share: number }[] = [];
  let [uncovered, pixels, count] = [0, 0, 0];
  for (const [i, { t_ms, quaternion }] of seen.entries()) {
    const view = viewOf(quaternion);
    asked.push({
      view: viewOf(said[0]?.[i]?.quaternion ?? quaternion),
      share: overscan === "auto" ? auto.at(t_ms) : overscan,
    });
    const frame = asked[i - late];
    if (frame === undefined) continue;
    auto.observe(frame.view, view, t_ms);
    uncovered += uncoveredShare(widened(frame.view, frame.share), view, 0);
    pixels += (1 + 2 * frame.share) ** 2;
    count++;
  }
  return { uncovered: uncovered / Math.max(1, count), pixels: pixels / Math.max(1, count) };
}

function viewOf(quaternion: Quaternion): View {
  return { ...SIZE, fx: FOCAL, fy: FOCAL, cx: SIZE.width / 2, cy: SIZE.height / 2, position: [0, 0, 0], quaternion };
}

function widened(view: View, share: number): View {
  const [marginX, marginY] = [share * view.width, share * view.height];
  return viewOfFrame(view, { width: view.width + 2 * marginX, height: view.height + 2 * marginY, marginX, marginY });
}
