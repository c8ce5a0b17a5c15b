/** Draws the distribution of latencies, with a line where interaction begins to feel slow. Loaded on demand. */
import { effect, type ReadonlySignal } from "@preact/signals";
import type uPlot from "uplot";
import type { Columns } from "#viewer/charts/history";
import { createChart, filled, interactiveLine, LATENCY_AXIS_BELOW, LATENCY_SCALE, percent } from "./uplot";

export function plotDistribution(
  place: HTMLElement,
  legend: HTMLElement,
  columns: ReadonlySignal<Columns>,
): () => void {
  const { chart, dispose } = createChart(place, legend, columns.peek(), (colours) => ({
    height: 128,
    padding: [8, 12, 0, 0],
    scales: { x: LATENCY_SCALE, y: { range: (_, __, max) => [0, Math.max(20, max ?? 0)] } },
    axes: [
      { ...LATENCY_AXIS_BELOW, size: 24, grid: { show: false } },
      { values: percent, size: 42, space: 28, grid: colours.grid },
    ],
    series: columns
      .peek()
      .slice(1)
      .map((_, i) => filled(colours, i, true)),
    hooks: interactiveLine("x", colours),
  }));
  const stopDrawing = effect(() => chart.setData(columns.value as uPlot.AlignedData));
  return () => {
    stopDrawing();
    dispose();
  };
}
