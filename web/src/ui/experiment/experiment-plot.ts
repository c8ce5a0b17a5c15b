/** Draws an experiment's results: one line per controller or mode. Loaded on demand. */
import type { Columns } from "../../charts/columns";
import { LATENCY_RANGE_MS } from "../../charts/histogram";
import { createChart, interactiveLine, LATENCY_AXIS, LATENCY_AXIS_BELOW, LATENCY_SCALE, percent } from "../chart/uplot";

/** The share of inputs that were shown within a time, or the latency over the time of the movement. */
export type ChartKind = "distribution" | "time";

/** In pixels, by the style of a swatch's border. */
const DASHES: Readonly<Record<string, number[]>> = { dotted: [2, 3], dashed: [7, 4], double: [8, 3, 2, 3] };

/** Draws into `place` until the function that it returns is called. */
export function plotResults(place: HTMLElement, legend: HTMLElement, kind: ChartKind, columns: Columns): () => void {
  const { chart, dispose } = createChart(place, legend, columns, (colours) => ({
    height: 190,
    padding: [8, 16, 0, 0],
    scales:
      kind === "distribution"
        ? { x: LATENCY_SCALE, y: { range: [0, 100] } }
        : {
            x: { time: false },
            y: { distr: 3, range: (_, __, max) => [LATENCY_RANGE_MS[0], Math.max(300, (max ?? 0) * 1.2)] },
          },
    axes: [
      {
        ...(kind === "distribution" ? LATENCY_AXIS_BELOW : { values: (_, splits) => splits.map((at) => `${at} s`) }),
        size: 24,
        grid: { show: false },
      },
      { ...(kind === "time" ? LATENCY_AXIS : { values: percent }), size: 46, space: 28, grid: colours.grid },
    ],
    series: columns.slice(1).map((_, i) => ({
      width: 1.75,
      stroke: () => colours.swatch(i).color,
      dash: DASHES[colours.swatch(i).borderTopStyle] ?? [],
      spanGaps: false,
    })),
    hooks: interactiveLine(kind === "distribution" ? "x" : "y", colours),
  }));
  // Nothing else would draw it anew when the theme changes.
  const theme = matchMedia("(prefers-color-scheme: dark)");
  const redraw = () => chart.redraw();
  theme.addEventListener("change", redraw);
  return () => {
    theme.removeEventListener("change", redraw);
    dispose();
  };
}
