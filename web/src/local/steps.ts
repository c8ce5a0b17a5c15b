/** When the picture is built anew while a scene comes in: seldom enough that it costs little, early enough that something is seen. */
import type { Prefix } from "./ply";

/** Of all Gaussians. Building one costs as much as the share that it has, so that all of them cost less than twice the last. */
const SHARES = [0.02, 0.05, 0.1, 0.25, 0.5, 1] as const;

/** What to draw next of what has arrived; null: what is drawn will do until more is there. */
export function nextStep(total: number, there: Prefix, drawn: Prefix | null): Prefix | null {
  if (there.whole) return drawn?.whole ? null : there;
  const reached = SHARES.map((share) => Math.ceil(share * total)).findLast((count) => count <= there.gaussians) ?? 0;
  return reached > (drawn?.gaussians ?? 0) ? { gaussians: reached, whole: false } : null;
}
