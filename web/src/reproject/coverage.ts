/** How much of a view the newest frame does not show: an estimate, without looking at a pixel. */
import { transfer, transferred } from "./homography";
import type { View } from "./view";

const COLUMNS = 32;
const ROWS = 18;

/** The share, 0 to 1, as if everything were at one inverse depth (1/z, in 1/scene units; 0: infinitely far). */
export function uncoveredShare(frame: View, view: View, inverseDepth: number): number {
  const toFrame = transfer(view, frame);
  let uncovered = 0;
  for (let row = 0; row < ROWS; row++) {
    for (let column = 0; column < COLUMNS; column++) {
      const u = ((column + 0.5) / COLUMNS) * view.width;
      const v = ((row + 0.5) / ROWS) * view.height;
      if (!inside(frame, transferred(toFrame, u, v, inverseDepth))) uncovered++;
    }
  }
  return uncovered / (COLUMNS * ROWS);
}

function inside({ width, height }: View, pixel: readonly [number, number] | null): boolean {
  return pixel !== null && pixel[0] >= 0 && pixel[0] <= width && pixel[1] >= 0 && pixel[1] <= height;
}
