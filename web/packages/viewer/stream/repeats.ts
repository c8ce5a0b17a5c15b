/**
 * Share of a stream's frames that repeat the view although the camera moves: the renderer or the encoder cannot keep
 * up.
 */
import type { SessionStatus } from "#client/wire/dash";

type Counts = Pick<SessionStatus, "id" | "frames" | "repeated" | "dropped">;

/** With a larger share, the server is the limit. */
export const MANY_REPEATS = 0.25;

/**
 * Share from `before` to `after`, 0 to 1, of frames repeated for lack of a newer view, or skipped; null without frames.
 */
export function repeatedShare(before: Counts | null, after: Counts | null): number | null {
  if (before === null || after === null || before.id !== after.id) return null;
  const ticks = after.frames - before.frames + (after.dropped - before.dropped);
  if (ticks <= 0) return null;
  return Math.min(1, (after.repeated - before.repeated + (after.dropped - before.dropped)) / ticks);
}
