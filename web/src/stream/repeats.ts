/** How many of a stream's frames show nothing new although the camera moves: renderer or encoder cannot keep up then, whatever the link. */
import type { SessionStatus } from "../wire/dash";

type Counts = Pick<SessionStatus, "id" | "frames" | "repeated" | "dropped">;

/** With a larger share, the server is the limit. */
export const MANY_REPEATS = 0.25;

/** From `before` to `after`, 0 to 1: frames that repeat the one before for want of a newer view, or were skipped; null without any. */
export function repeatedShare(before: Counts | null, after: Counts | null): number | null {
  if (before === null || after === null || before.id !== after.id) return null;
  const ticks = after.frames - before.frames + (after.dropped - before.dropped);
  if (ticks <= 0) return null;
  return Math.min(1, (after.repeated - before.repeated + (after.dropped - before.dropped)) / ticks);
}
