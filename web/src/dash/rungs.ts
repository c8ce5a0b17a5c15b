/** Which rungs of the ladder a stream offers. */
import type { Rung } from "../wire";

/** Those that have no more pixels than the viewport, since more would be thrown away; at least the smallest. */
export function rungsFor(
  ladder: readonly Pick<Rung, "width" | "height">[],
  viewport: { readonly width: number; readonly height: number },
): number[] {
  const pixels = ladder.map(({ width, height }) => width * height);
  const limit = Math.max(viewport.width * viewport.height, Math.min(...pixels));
  return pixels.flatMap((count, rung) => (count <= limit ? [rung] : []));
}
