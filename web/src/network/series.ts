/** The last minute of some quantities, in the columns that a chart draws. */
import type { Stats } from "../player/stats";
import type { ShaperStatus } from "../shaper-wire";

/** Seconds. */
export const SPAN = 60;
/** No line is drawn across a longer time without samples, in seconds. */
const GAP = 2;

type Column = readonly (number | null)[];
/** Times in seconds, rising; and the values of each quantity at them. */
export type Columns = readonly [times: readonly number[], ...values: Column[]];

export function noColumns(quantities: number): Columns {
  return [[], ...Array.from({ length: quantities }, () => [])];
}

/** The columns with one sample more, without what is older than the span. */
export function append(columns: Columns, time: number, values: Column): Columns {
  const [times, ...series] = columns;
  const last = times.at(-1);
  const broken = last !== undefined && time - last > GAP;
  const kept = times.findIndex((at) => at >= time - SPAN);
  const from = kept < 0 ? times.length : kept;
  return [
    [...times.slice(from), ...(broken ? [time - GAP / 2] : []), time],
    ...series.map((column, i) => [...column.slice(from), ...(broken ? [null] : []), values[i] ?? null]),
  ];
}

/** Towards the client, Mbit/s: target, delivered. */
export function rates({ down }: ShaperStatus): Column {
  return [down.target_kbps / 1000, down.delivered_kbps / 1000];
}

/** The newest frame's size in kB and the round trip in ms; nothing where no frame was shown since `shown`. */
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
