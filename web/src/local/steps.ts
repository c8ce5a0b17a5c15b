/** When the picture is built anew while a scene comes in: seldom enough that it costs little, early enough that something is seen. */
import { partsOf } from "./growth";
import type { PlyHeader, Prefix } from "./ply";

/** Of all Gaussians, in files that name no parts. Building one costs as much as its share, so all cost less than twice the last. */
const SHARES = [0.02, 0.05, 0.1, 0.25, 0.5] as const;

/** What to draw next of what has arrived; null: what is drawn will do until more is there. */
export function nextStep(
  { gaussians, lines }: Pick<PlyHeader, "gaussians" | "lines">,
  there: Prefix,
  drawn: Prefix | null,
): Prefix | null {
  if (there.whole) return drawn?.whole ? null : there;
  const said = partsOf(lines);
  const parts = said.length > 0 ? said : SHARES.map((share) => Math.ceil(share * gaussians));
  const reached = [...parts, gaussians].findLast((count) => count <= there.gaussians) ?? 0;
  return reached > (drawn?.gaussians ?? 0) ? { gaussians: reached, whole: false } : null;
}
