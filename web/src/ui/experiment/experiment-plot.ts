/** Draws an experiment's results with uPlot: one line per controller or mode. Loaded on demand. */
import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import type { Columns } from "../../charts/columns";
import { LATENCY_RANGE_MS } from "../../charts/histogram";
import { drawLimit, logAxis } from "../chart/distribution-plot";
import { chartColours, FONT } from "../chart/live-plot";

/** The share of inputs that were shown within a time, or the latency over the time of the movement. */
export type ChartKind = "distribution" | "time";

const HEIGHT = 190;

/** Draws into `place` until the function that it returns is called. Colours are those of the legend's swatches. */
export function plotResults(place: HTMLElement, legend: HTMLElement, kind: ChartKind, columns: Columns): () => void {
  const { swatch, text, grid } = chartColours(place, legend);
  const axis: uPlot.Axis = { stroke: text, font: FONT, gap: 4, ticks: { show: false } };
  const chart = new uPlot(
    {
      width: place.clientWidth,
      height: HEIGHT,
      padding: [8, 16, 0, 0],
      cursor: { show: false },
      legend: { show: false },
      scales:
        kind === "distribution"
          ? { x: { time: false, distr: 3, range: [...LATENCY_RANGE_MS] }, y: { range: [0, 100] } }
          : {
              x: { time: false },
              y: { distr: 3, range: (_, __, max) => [LATENCY_RANGE_MS[0], Math.max(300, (max ?? 0) * 1.2)] },
            },
      axes: [
        kind === "distribution"
          ? { ...axis, ...logAxis, size: 24, grid: { show: false } }
          : { ...axis, size: 24, grid: { show: false }, values: (_, splits) => splits.map((at) => `${at} s`) },
        { ...axis, ...(kind === "time" && logAxis), size: 40, space: 28, grid },
      ],
      series: [
        {},
        ...columns.slice(1).map(
          (_, i): uPlot.Series => ({
            width: 1.75,
            stroke: () => swatch(i).color,
            points: { show: false },
            spanGaps: false,
          }),
        ),
      ],
      hooks: { drawAxes: [(drawn) => drawLimit(drawn, kind === "distribution" ? "x" : "y", text())] },
    },
    columns as uPlot.AlignedData,
    place,
  );
  const observer = new ResizeObserver(() => chart.setSize({ width: place.clientWidth, height: HEIGHT }));
  observer.observe(place);
  // Nothing else would draw it anew when the theme changes.
  const theme = matchMedia("(prefers-color-scheme: dark)");
  const redraw = () => chart.redraw();
  theme.addEventListener("change", redraw);
  return () => {
    theme.removeEventListener("change", redraw);
    observer.disconnect();
    chart.destroy();
  };
}
