/** A wider lens: it covers more than the view, so that the page can warp the picture later and still fill the view. */
import { resized } from "../reproject/view";
import { type Intrinsics, type Viewport, viewportFor } from "../view/intrinsics";

/** Default margin of a stream; changing it would mean opening another stream. */
export const AUTO_OVERSCAN = 0.1;

/** The same camera with this margin at each side, as a share of width and height; within the server's limits. */
export function widened<View extends Intrinsics & Viewport>(view: View, overscan: number): View {
  const marginX = Math.round(view.width * overscan);
  const marginY = Math.round(view.height * overscan);
  const wide = {
    ...view,
    cx: view.cx + marginX,
    cy: view.cy + marginY,
    width: view.width + 2 * marginX,
    height: view.height + 2 * marginY,
  };
  const { width, height } = viewportFor(wide.width, wide.height);
  return resized(wide, width, height);
}
