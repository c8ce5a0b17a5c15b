/**
 * The viewer's record of a run, in the store's form; all times are milliseconds since the run's start. Pure: time is
 * part of each event.
 */
import type { Input, Recording } from "#client/wire/store";
import { median } from "#viewer/enhance/median";
import type { SentRequest } from "#viewer/stateless/pipeline";
import type { Reply } from "#viewer/stateless/stateless-player";
import type { ScenePose } from "#viewer/view/camera";
import type { PresentedFrame } from "#viewer/view/presented";
import { type NumberedPose, samePose } from "#viewer/view/rig";

/*
 * Inputs that a stalled page did not sample. Ignoring them would leave out exactly the worst served poses (coordinated
 * omission). Pure.
 */

/** A gap longer than a short one by this factor has missed a frame. */
const MISSED_AFTER = 1.5;

/** Minimum number of frames of a resting page: with fewer, a single late one counts too much. */
const LEAST_AT_REST = 20;

/**
 * The display's frame interval in milliseconds, from animation frames of an idle page; null with too few. A busy page
 * is unsuitable: one that always misses every other frame looks like a slower display.
 */
export function intervalAtRest(times: readonly number[]): number | null {
  return times.length > LEAST_AT_REST ? median(gapsOf(times)) : null;
}

/**
 * The interval between animation frames of a busy page, in milliseconds; null with fewer than two. It is the mean of
 * the gaps without a missed frame: up to 1.5 times a short gap, which is the tenth percentile.
 */
export function displayInterval(times: readonly number[]): number | null {
  const sorted = gapsOf(times)
    .filter((gap) => gap > 0)
    .sort((a, b) => a - b);
  const short = sorted[Math.floor(sorted.length / 10)];
  if (short === undefined) return null;
  const whole = sorted.filter((gap) => gap <= MISSED_AFTER * short);
  return whole.reduce((a, b) => a + b) / whole.length;
}

function gapsOf(times: readonly number[]): number[] {
  return times.slice(1).map((time, i) => time - (times[i] as number));
}

/** Due times of the display's frames that got no animation frame. */
export function missedFrames(times: readonly number[], interval: number): number[] {
  return times.slice(1).flatMap((time, i) => {
    const before = times[i] as number;
    const frames = Math.round((time - before) / interval);
    return Array.from({ length: Math.max(0, frames - 1) }, (_, k) => before + (k + 1) * interval);
  });
}

/** Events of a run. */
export type RecordedEvents = Required<
  Pick<Recording, "inputs" | "frames" | "replies" | "requests" | "captures" | "traffic">
>;

export interface RecorderStart {
  /** On the page's clock. */
  readonly startedAt: number;
  /** How long the movement lasts. */
  readonly duration: number;
  /** The viewer's intended pose, this many milliseconds after the start. */
  readonly movement: (elapsed: number) => ScenePose;
  /** The display's frame interval in milliseconds, measured at rest; null if unknown. */
  readonly atRest?: number | null;
  /** The number of the pose that is on the screen. */
  readonly pose: number;
  readonly received: number;
  /** Interval of capturing pictures while the movement lasts, first after `captureOffset`; 0 captures none. */
  readonly captureEvery: number;
  readonly captureOffset: number;
}

/** A pose number that is never sampled. */
const NO_POSE = -1;

export class Recorder {
  readonly #start: RecorderStart;
  readonly #inputs: RecordedEvents["inputs"] = [];
  readonly #frames: RecordedEvents["frames"] = [];
  readonly #replies: RecordedEvents["replies"] = [];
  readonly #requests: SentRequest[] = [];
  /** Times of all samples. */
  readonly #sampledAt: number[] = [];
  readonly #captures: RecordedEvents["captures"] = [];
  readonly #traffic: RecordedEvents["traffic"] = [];
  #pose: number;
  #shown: number;
  #captureAt: number;

  constructor(start: RecorderStart) {
    this.#start = start;
    this.#pose = start.pose;
    this.#shown = start.pose;
    this.#captureAt = start.captureOffset;
  }

  /** Records that the rig has had a pose since a time. */
  sampled({ seq, position, quaternion }: NumberedPose, at: number): void {
    this.#sampledAt.push(at - this.#start.startedAt);
    if (seq === this.#pose) return;
    this.#pose = seq;
    this.#inputs.push({ at: at - this.#start.startedAt, pose: seq, position, quaternion, missed: false });
  }

  /** Number of captures that have become due since the last call. */
  due(now: number): number {
    const { startedAt, captureEvery, duration } = this.#start;
    if (captureEvery === 0) return 0;
    const last = duration - 1e-3; // rounded sums must not give one more than fits into the duration
    let ticks = 0;
    for (; this.#captureAt <= now - startedAt && this.#captureAt < last; this.#captureAt += captureEvery) ticks++;
    return ticks;
  }

  presented(frame: PresentedFrame): void {
    const at = frame.at - this.#start.startedAt;
    if (at < 0) return;
    const { shownWidth, shownHeight, enhanceMs, view, filled, warpMs, ...shown } = frame;
    this.#frames.push({
      ...shown,
      at,
      view: view ?? null,
      filled: filled ?? null,
      warp_ms: warpMs ?? null,
      latencies: [...frame.latencies],
      shown_width: shownWidth ?? null,
      shown_height: shownHeight ?? null,
      enhance_ms: enhanceMs ?? null,
    });
    this.#shown = Math.max(this.#shown, frame.pose);
  }

  sent(request: SentRequest): void {
    this.#requests.push(request);
  }

  replied({ arrival, pose, asked, profile, server, throughput }: Reply): void {
    const { startedAt } = this.#start;
    this.#replies.push({
      at: arrival.lastByteAt - startedAt,
      asked_at: arrival.sentAt - startedAt,
      first_byte_at: arrival.firstByteAt - startedAt,
      pose,
      asked_rung: asked,
      rung: profile,
      bytes: arrival.bytes,
      server,
      throughput_kbps: throughput === null ? null : Math.round(throughput / 1000),
    });
  }

  /** Records a capture of the frame that was on the screen at a time. */
  captured(frame: PresentedFrame, at: number, picture: { readonly width: number; readonly height: number }): void {
    const { startedAt } = this.#start;
    const { pose, view = null, filled = null, rung } = frame;
    const { width, height } = picture;
    // A video frame is reported shortly before it is on the screen.
    const seenAt = Math.max(at, frame.at) - startedAt;
    this.#captures.push({ at: seenAt, shown_at: frame.at - startedAt, pose, view, filled, rung, width, height });
  }

  /** Records an empty capture, at a time before the first frame. */
  capturedNothing(at: number, { width, height }: { readonly width: number; readonly height: number }): void {
    const nothing = { shown_at: 0, pose: NO_POSE, view: null, filled: null, rung: null };
    this.#captures.push({ at: at - this.#start.startedAt, ...nothing, width, height });
  }

  /** Records the total bytes received since the page was opened. */
  received(bytes: number, at: number): void {
    this.#traffic.push({ at: at - this.#start.startedAt, bytes: bytes - this.#start.received });
  }

  /** Whether the movement's last pose was sampled and is on the screen. */
  get settled(): boolean {
    return (this.#sampledAt.at(-1) ?? 0) >= this.#start.duration && this.#shown >= this.#pose;
  }

  /** The interval between the run's animation frames, in milliseconds; null with fewer than two. */
  get animationInterval(): number | null {
    return displayInterval(this.#sampledAt);
  }

  /** The display's frame interval in milliseconds, which the page may never have kept up with; null if unknown. */
  get displayInterval(): number | null {
    const known = [this.animationInterval, this.#start.atRest].filter((interval) => interval != null);
    return known.length > 0 ? Math.min(...known) : null;
  }

  /** All events, sorted by time because a video's frames are reported when decoded, not when shown. */
  get events(): RecordedEvents {
    return {
      inputs: [...this.#inputs, ...this.#missed()].sort((a, b) => a.at - b.at),
      frames: this.#frames.toSorted((a, b) => a.at - b.at),
      replies: this.#replies.toSorted((a, b) => a.at - b.at),
      requests: this.#requests.map(({ at, pose, asked, fate }) => ({
        at: at - this.#start.startedAt,
        pose,
        asked_rung: asked,
        fate,
      })),
      captures: this.#captures,
      traffic: this.#traffic,
    };
  }

  /** The poses that were due while the page stalled, except where no later one was sampled: the view was back at the picture's pose. */
  #missed(): Input[] {
    const interval = this.displayInterval ?? Number.POSITIVE_INFINITY;
    const { movement } = this.#start;
    return missedFrames(this.#sampledAt, interval).flatMap((at) => {
      const next = this.#inputs.find((input) => input.at > at);
      const due = movement(at);
      if (next === undefined || samePose(due, movement(at - interval))) return [];
      return { at, pose: next.pose, position: [...due.position], quaternion: [...due.quaternion], missed: true };
    });
  }
}
