/** Draws the distribution of latencies with uPlot, with a line where interaction begins to feel slow. Loaded on demand. */
import { effect, type ReadonlySignal } from "@preact/signals";
import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import type { Columns } from "../../charts/columns";
import { LATENCY_RANGE_MS } from "../../charts/histogram";
import { INTERACTIVE } from "../../experiment/figures";
import { chartColours, FONT, HEIGHT } from "./live-plot";

const TICKS = [10, 30, 100, 300, 1000, 3000];

/** Latencies on a logarithmic axis. */
export const logAxis: Pick<uPlot.Axis, "splits" | "filter" | "values"> = {
  splits: () => TICKS,
  filter: (_, splits) => splits,
  values: (_, splits) => splits.map((at) => (at < 1000 ? `${at}` : `${at / 1000} s`)),
};

/** Draws into `place` until the function that it returns is called. Colours are those of the legend's swatches. */
export function plotDistribution(
  place: HTMLElement,
  legend: HTMLElement,
  columns: ReadonlySignal<Columns>,
): () => void {
  const { swatch, text, grid } = chartColours(place, legend);
  const bars = uPlot.paths.stepped?.({ align: 1 });
  const series = (i: number): uPlot.Series => ({
    width: 1.5,
    stroke: () => swatch(i).color,
    fill: () => swatch(i).backgroundColor,
    points: { show: false },
    ...(bars && { paths: bars }),
  });
  const chart = new uPlot(
    {
      width: place.clientWidth,
      height: HEIGHT,
      padding: [8, 12, 0, 0],
      cursor: { show: false },
      legend: { show: false },
      scales: {
        x: { time: false, distr: 3, range: [...LATENCY_RANGE_MS] },
        y: { range: (_, __, max) => [0, Math.max(20, max ?? 0)] },
      },
      axes: [
        {
          stroke: text,
          font: FONT,
          size: 24,
          gap: 4,
          grid: { show: false },
          ticks: { show: false },
          ...logAxis,
        },
        { stroke: text, font: FONT, size: 36, gap: 4, space: 28, grid, ticks: { show: false } },
      ],
      series: [{}, series(0), series(1)],
      hooks: { drawAxes: [(drawn) => drawLimit(drawn, "x", text())] },
    },
    columns.peek() as uPlot.AlignedData,
    place,
  );
  const stopDrawing = effect(() => chart.setData(columns.value as uPlot.AlignedData));
  const observer = new ResizeObserver(() => chart.setSize({ width: place.clientWidth, height: HEIGHT }));
  observer.observe(place);
  return () => {
    observer.disconnect();
    stopDrawing();
    chart.destroy();
  };
}

/** A line across the chart at the latency that counts as immediate, of the axis that latencies are on. */
export function drawLimit({ ctx, bbox, valToPos }: uPlot, axis: "x" | "y", ink: string): void {
  const at = Math.round(valToPos(INTERACTIVE, axis, true));
  ctx.save();
  ctx.strokeStyle = ink;
  ctx.setLineDash([4, 4]);
  ctx.beginPath();
  ctx.moveTo(axis === "x" ? at : bbox.left, axis === "x" ? bbox.top : at);
  ctx.lineTo(axis === "x" ? at : bbox.left + bbox.width, axis === "x" ? bbox.top + bbox.height : at);
  ctx.stroke();
  ctx.restore();
}
