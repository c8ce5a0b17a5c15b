/**
 * What a page that stalled did not sample. A loop that waits for the page would never ask where the viewer was meanwhile, and
 * leave out just the poses that were worst served (coordinated omission). Pure.
 */

/** A gap so many times as long as a short one has missed a frame. */
const MISSED_AFTER = 1.5;

/**
 * Between two frames of the display, in milliseconds, from the times of animation frames; null with less than two. The mean
 * of the gaps in which no frame was missed: those up to 1.5 times a short one, that of the tenth percentile.
 */
export function displayInterval(times: readonly number[]): number | null {
  const gaps = times.slice(1).map((time, i) => time - (times[i] as number));
  const sorted = gaps.filter((gap) => gap > 0).sort((a, b) => a - b);
  const short = sorted[Math.floor(sorted.length / 10)];
  if (short === undefined) return null;
  const whole = sorted.filter((gap) => gap <= MISSED_AFTER * short);
  return whole.reduce((a, b) => a + b) / whole.length;
}

/** The frames of the display without an animation frame: when each was due. */
export function missedFrames(times: readonly number[], interval: number): number[] {
  return times.slice(1).flatMap((time, i) => {
    const before = times[i] as number;
    const frames = Math.round((time - before) / interval);
    return Array.from({ length: Math.max(0, frames - 1) }, (_, k) => before + (k + 1) * interval);
  });
}
