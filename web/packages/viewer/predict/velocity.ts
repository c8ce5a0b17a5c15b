/** Extrapolates the camera's recent velocity, constant in its own frame. */
import { changed, type Predict } from "./pose-history";

/** Milliseconds over which the velocity is measured: long enough to average out noise. */
const SPAN = 50;

export const velocity: Predict = (history, ahead) => {
  const span = Math.min(SPAN, history.known);
  if (span === 0) return history.last;
  const { moved, turned } = history.since(span);
  const times = -ahead / span;
  const [mx, my, mz] = moved;
  const [tx, ty, tz] = turned;
  return changed(history.last, {
    moved: [mx * times, my * times, mz * times],
    turned: [tx * times, ty * times, tz * times],
  });
};
