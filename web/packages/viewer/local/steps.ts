/** When to rebuild the picture during a download: rarely enough to be cheap, early enough to show something. */
import { partsOf } from "./growth";
import type { PlyHeader, Prefix } from "./ply";

/** Of all Gaussians, in files that name no parts. Building one costs as much as its share, so all cost less than twice the last. */
const SHARES = [0.02, 0.05, 0.1, 0.25, 0.5] as const;

/** The next part to render of the received one; null: wait for more. */
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
