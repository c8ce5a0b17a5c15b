/** The last minute of some quantities, in the columns that a chart draws. */
/** Seconds. */
export const SPAN_S = 60;
/** No line is drawn across a longer time without samples, in seconds. */
const GAP = 2;

export type Column = readonly (number | null)[];
/** Times in seconds, rising; and the values of each quantity at them. */
export type Columns = readonly [times: readonly number[], ...values: Column[]];

export function noColumns(quantities: number): Columns {
  return [[], ...Array.from({ length: quantities }, () => [])];
}

/** The columns with an additional sample, without those older than the span. */
export function append(columns: Columns, time: number, values: Column): Columns {
  const [times, ...series] = columns;
  const last = times.at(-1);
  const broken = last !== undefined && time - last > GAP;
  const kept = times.findIndex((at) => at >= time - SPAN_S);
  const from = kept < 0 ? times.length : kept;
  return [
    [...times.slice(from), ...(broken ? [time - GAP / 2] : []), time],
    ...series.map((column, i) => [...column.slice(from), ...(broken ? [null] : []), values[i] ?? null]),
  ];
}
