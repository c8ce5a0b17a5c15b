/** Draws an experiment's results: one line per controller or mode. Loaded on demand. */
import type { Columns } from "../../charts/columns";
import { LATENCY_RANGE_MS } from "../../charts/histogram";
import { createChart, interactiveLine, LATENCY_AXIS, LATENCY_SCALE } from "../chart/uplot";

/** The share of inputs that were shown within a time, or the latency over the time of the movement. */
export type ChartKind = "distribution" | "time";

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
        ...(kind === "distribution" ? LATENCY_AXIS : { values: (_, splits) => splits.map((at) => `${at} s`) }),
        size: 24,
        grid: { show: false },
      },
      { ...(kind === "time" && LATENCY_AXIS), size: 40, space: 28, grid: colours.grid },
    ],
    series: columns.slice(1).map((_, i) => ({
      width: 1.75,
      stroke: () => colours.swatch(i).color,
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
