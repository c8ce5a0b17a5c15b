/** Series of the network panel: the link's rates, our frames, and a trace's outline. */

import type { ShaperStatus } from "#client/wire/shaper";
import type { Column } from "#viewer/charts/columns";
import type { Stats } from "#viewer/stateless/stats";
/** Towards the client, Mbit/s: target, delivered. */
export function rates({ down }: ShaperStatus): Column {
  return [down.target_kbps / 1000, down.delivered_kbps / 1000];
}

/** The newest frame's size in kB and the round trip in ms; undefined if no frame was shown since `shown`. */
export function frames({ frame, roundTrip, shown }: Stats, shownBefore: number): Column {
  return frame && shown !== shownBefore ? [frame.bytes / 1000, roundTrip] : [null, null];
}

/** A step function's outline as an SVG path over a box, the highest value at its top. */
export function stepPath(
  times: readonly number[],
  values: readonly number[],
  end: number,
  box: [number, number],
): string {
  const [width, height] = box;
  const top = Math.max(...values, Number.MIN_VALUE);
  const x = (time: number) => ((time / end) * width).toFixed(1);
  const y = (value: number) => (height - (value / top) * height).toFixed(1);
  const steps = values.map((value, i) => `${i === 0 ? "M0 " : "V"}${y(value)}H${x(times[i + 1] ?? end)}`);
  return steps.join("");
}
