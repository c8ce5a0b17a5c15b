/**
 * Inputs that a stalled page did not sample. Ignoring them would leave out exactly the worst served poses (coordinated
 * omission). Pure.
 */
import { median } from "#viewer/enhance/median";

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
 * Between two animation frames, in milliseconds, as a busy page shows them; null with less than two. The mean
 * of the gaps in which no frame was missed: those up to 1.5 times a short one, that of the tenth percentile.
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

/** The frames of the display without an animation frame: when each was due. */
export function missedFrames(times: readonly number[], interval: number): number[] {
  return times.slice(1).flatMap((time, i) => {
    const before = times[i] as number;
    const frames = Math.round((time - before) / interval);
    return Array.from({ length: Math.max(0, frames - 1) }, (_, k) => before + (k + 1) * interval);
  });
}
