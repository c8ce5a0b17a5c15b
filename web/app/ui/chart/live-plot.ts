/** Draws the last minute of some quantities. Loaded on demand, so that a page without a shaper does not pay for it. */
import { effect, type ReadonlySignal } from "@preact/signals";
import type uPlot from "uplot";
import { type Columns, SPAN_S } from "#viewer/charts/history";
import { createChart, filled } from "./uplot";

export interface Quantity {
  readonly label: string;
  readonly unit: string;
  /** Name of the axis: quantities of one unit share it. */
  readonly axis: "left" | "right";
  readonly tone: "target" | "measured" | "second" | "left" | "right";
  /** Each value holds until the next one. */
  readonly stepped?: boolean;
}

export function plotLive(
  place: HTMLElement,
  legend: HTMLElement,
  quantities: readonly Quantity[],
  columns: ReadonlySignal<Columns>,
): () => void {
  const sides = [...new Set(quantities.map(({ axis }) => axis))];
  const valueScale: uPlot.Scale = { range: (_, __, max) => paddedRange(max) };
  const { chart, dispose } = createChart(place, legend, columns.peek(), (colours) => ({
    height: 128,
    padding: [8, sides.includes("right") ? 0 : 12, 0, 0],
    scales: {
      x: { time: false, range: (_, __, max) => [max - SPAN_S, max] },
      ...Object.fromEntries(sides.map((side) => [side, valueScale])),
    },
    axes: [
      {
        size: 24,
        grid: { show: false },
        splits: (_, __, ___, max) => [max - SPAN_S, max - SPAN_S / 2, max],
        values: () => [`−${SPAN_S} s`, `−${SPAN_S / 2} s`, "now"],
      },
      ...sides.map(
        (side): uPlot.Axis => ({
          label: quantities.find(({ axis }) => axis === side)?.unit ?? "",
          scale: side,
          side: side === "left" ? 3 : 1,
          size: 36,
          space: 28,
          grid: side === "left" ? colours.grid : { show: false },
        }),
      ),
    ],
    series: quantities.map(({ axis, stepped = false }, i) => ({ ...filled(colours, i, stepped), scale: axis })),
  }));
  const stopDrawing = effect(() => chart.setData(columns.value as uPlot.AlignedData));
  return () => {
    stopDrawing();
    dispose();
  };
}

/** From zero to a little above the highest value. */
function paddedRange(max: number | null): [number, number] {
  return [0, Math.max(1, (max ?? 0) * 1.1)];
}
