/**
 * The figures of a run that the page shows, with the definitions of `docs/experiments.md`: the twin of the store's
 * (`tigas_experiments/records/statistics.py`) for runs that no store keeps. The tests of both read `figures.golden.json`. Pure.
 */
import { AGE_EVERY_MS, INTERACTIVE_MS, USUAL_INTERVAL_MS } from "../wire/figures";
import type { Recording } from "../wire/store";
import type { RecordedEvents } from "./recorder";

export interface RunFigures {
  /** Motion-to-photon latency of the content in milliseconds; null: that share of the inputs was never answered, or nothing moved. */
  readonly p50: number | null;
  readonly p90: number | null;
  readonly p95: number | null;
  readonly p99: number | null;
  /** The same until the picture was warped, whatever the age of its pixels. */
  readonly viewP50: number | null;
  readonly viewP95: number | null;
  /** Of all inputs, those shown within `INTERACTIVE_MS`, 0 to 1; null if nothing moved. */
  readonly interactive: number | null;
  /** The same, were the limit one frame of the display less, or one more. */
  readonly interactiveFrameLess: number | null;
  readonly interactiveFrameMore: number | null;
  /** How long ago the viewer was last where the picture on the screen is from, mean over time, in milliseconds; null if nothing moved. */
  readonly contentAge: number | null;
  /** Frames a second that show a later pose than all before them: a video repeats pictures. */
  readonly newViewsPerSecond: number;
  /** Height on screen, weighted by time, in pixels; null without frames. */
  readonly meanHeight: number | null;
  /** Changes of the ladder's rung. */
  readonly switches: number;
  /** Received rate of frames or segments, in bits per second; null if not counted. */
  readonly received: number | null;
}

/** An input, and how long it took until it was on the screen, both in milliseconds; infinite if no frame ever showed it. */
export interface InputLatency {
  readonly at: number;
  readonly latency: number;
}

type Frame = RecordedEvents["frames"][number];

/** The pose that a frame's pixels are of. */
const content = ({ pose }: Frame) => pose;
/** The pose that a picture shows, with or without a warp. */
const view = ({ pose, view }: Frame) => view ?? pose;

/** For each input, the first frame of its pose or of a later one. */
export function inputLatencies(
  { inputs, frames }: Pick<RecordedEvents, "inputs" | "frames">,
  poseOf: (frame: Frame) => number = content,
): InputLatency[] {
  let next = 0;
  let newest = -1;
  return inputs.map(({ at, pose }) => {
    // Poses and times grow, so the answering frame never goes back.
    for (let frame = frames[next]; frame !== undefined; frame = frames[++next]) {
      newest = Math.max(newest, poseOf(frame));
      if (newest >= pose) return { at, latency: frame.at - at };
    }
    return { at, latency: Number.POSITIVE_INFINITY };
  });
}

export function figures(
  recording: Pick<RecordedEvents, "inputs" | "frames" | "traffic"> &
    Pick<Recording, "duration_ms" | "display_interval_ms">,
): RunFigures {
  const { frames, traffic, duration_ms } = recording;
  const latencies = inputLatencies(recording).map(({ latency }) => latency);
  const views = inputLatencies(recording, view).map(({ latency }) => latency);
  const during = frames.filter(({ at }) => at >= 0 && at <= duration_ms);
  const rungs = during.flatMap(({ rung }) => rung ?? []);
  const interval = recording.display_interval_ms ?? USUAL_INTERVAL_MS;
  const within = (limit: number) =>
    latencies.length ? latencies.filter((latency) => latency <= limit).length / latencies.length : null;
  return {
    p50: percentile(latencies, 0.5),
    p90: percentile(latencies, 0.9),
    p95: percentile(latencies, 0.95),
    p99: percentile(latencies, 0.99),
    viewP50: percentile(views, 0.5),
    viewP95: percentile(views, 0.95),
    interactive: within(INTERACTIVE_MS),
    interactiveFrameLess: within(INTERACTIVE_MS - interval),
    interactiveFrameMore: within(INTERACTIVE_MS + interval),
    contentAge: contentAge(recording, interval),
    newViewsPerSecond: (newViews(during) * 1000) / duration_ms,
    meanHeight: meanHeight(during, duration_ms),
    switches: rungs.filter((rung, i) => i > 0 && rung !== rungs[i - 1]).length,
    received: rate(traffic.filter(({ at }) => at <= duration_ms)),
  };
}

/** The nearest-rank percentile (rank 0 to 1); null where it is not finite, or without values. */
export function percentile(values: readonly number[], rank: number): number | null {
  const sorted = values.toSorted((a, b) => a - b);
  const value = sorted[Math.max(0, Math.ceil(rank * sorted.length) - 1)];
  return value === undefined || !Number.isFinite(value) ? null : value;
}

/** At each tick: since the last frame of the display in which the viewer was where the picture is from; 0 while still there. */
function contentAge(
  { inputs, frames, duration_ms }: Pick<Recording, "inputs" | "frames" | "duration_ms">,
  interval: number,
): number | null {
  if (inputs.length === 0) return null;
  const ticks = Math.ceil(duration_ms / AGE_EVERY_MS);
  let shown = -1; // at first, the picture of the time before the run
  let next = 0;
  let sum = 0;
  for (let at = 0; at < ticks * AGE_EVERY_MS; at += AGE_EVERY_MS) {
    for (let frame = frames[next]; frame !== undefined && frame.at <= at; frame = frames[++next]) shown = frame.pose;
    const newer = inputs[firstNewer(inputs, shown)];
    if (newer !== undefined && newer.at <= at) sum += at - newer.at + interval;
  }
  return sum / ticks;
}

/** Where the first input of a later pose is; poses do not go back. */
function firstNewer(inputs: RecordedEvents["inputs"], pose: number): number {
  let [low, high] = [0, inputs.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if ((inputs[middle]?.pose ?? 0) <= pose) low = middle + 1;
    else high = middle;
  }
  return low;
}

function newViews(frames: RecordedEvents["frames"]): number {
  let newest = Number.NEGATIVE_INFINITY;
  return frames.filter(({ pose }) => {
    const later = pose > newest;
    newest = Math.max(newest, pose);
    return later;
  }).length;
}

function meanHeight(frames: RecordedEvents["frames"], duration: number): number | null {
  let sum = 0;
  let lasted = 0;
  frames.forEach(({ at, height }, i) => {
    const time = (frames[i + 1]?.at ?? duration) - at;
    sum += time * height;
    lasted += time;
  });
  return lasted > 0 ? sum / lasted : null;
}

function rate(traffic: RecordedEvents["traffic"]): number | null {
  const [first, last] = [traffic.at(0), traffic.at(-1)];
  if (first === undefined || last === undefined || last.at <= first.at) return null;
  return ((last.bytes - first.bytes) * 8000) / (last.at - first.at);
}
