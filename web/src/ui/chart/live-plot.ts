/** Draws a live chart with uPlot. Loaded on demand, so that a page without a shaper does not pay for it. */
import { effect, type ReadonlySignal } from "@preact/signals";
import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import { type Columns, SPAN_S } from "../../charts/columns";

export interface Quantity {
  readonly label: string;
  readonly unit: string;
  /** Whose axis it has: quantities of one unit share one. */
  readonly axis: "left" | "right";
  readonly tone: "target" | "measured" | "second" | "stateless" | "dash";
  /** Each value holds until the next one. */
  readonly stepped?: boolean;
}

export const HEIGHT = 128;
export const FONT = "11px system-ui, sans-serif";
const steps = uPlot.paths.stepped?.({ align: 1 });

/** Draws into `place` until the function that it returns is called. Colours are those of the legend's swatches. */
export function plotLive(
  place: HTMLElement,
  legend: HTMLElement,
  quantities: readonly Quantity[],
  columns: ReadonlySignal<Columns>,
): () => void {
  const { swatch, text, grid } = chartColours(place, legend);
  const sides = [...new Set(quantities.map(({ axis }) => axis))];
  const chart = new uPlot(
    {
      width: place.clientWidth,
      height: HEIGHT,
      padding: [8, sides.includes("right") ? 0 : 12, 0, 0],
      cursor: { show: false },
      legend: { show: false },
      scales: {
        x: { time: false, range: (_, __, max) => [max - SPAN_S, max] },
        ...Object.fromEntries(
          sides.map((side) => [side, { range: (_: uPlot, __: number, max: number) => paddedRange(max) }]),
        ),
      },
      axes: [
        {
          stroke: text,
          font: FONT,
          size: 24,
          gap: 4,
          grid: { show: false },
          ticks: { show: false },
          splits: (_, __, ___, max) => [max - SPAN_S, max - SPAN_S / 2, max],
          values: () => [`−${SPAN_S} s`, `−${SPAN_S / 2} s`, "now"],
        },
        ...sides.map(
          (side): uPlot.Axis => ({
            scale: side,
            side: side === "left" ? 3 : 1,
            stroke: text,
            font: FONT,
            size: 36,
            gap: 4,
            space: 28,
            grid: side === "left" ? grid : { show: false },
            ticks: { show: false },
          }),
        ),
      ],
      series: [
        {},
        ...quantities.map(
          ({ axis, stepped }, i): uPlot.Series => ({
            scale: axis,
            width: 1.5,
            stroke: () => swatch(i).color,
            fill: () => swatch(i).backgroundColor,
            points: { show: false },
            ...(stepped && steps && { paths: steps }),
          }),
        ),
      ],
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

/** Where a chart's colours come from. They are asked for anew at each drawing, so that it follows the theme. */
export function chartColours(place: HTMLElement, legend: HTMLElement) {
  const swatches = [...legend.querySelectorAll(".swatch")];
  return {
    swatch: (i: number) => getComputedStyle(swatches[i] ?? place),
    text: () => getComputedStyle(place).color,
    grid: { stroke: () => getComputedStyle(place).borderTopColor, width: 1 },
  };
}

/** From zero to a little above the highest value. */
function paddedRange(max: number | null): [number, number] {
  return [0, Math.max(1, (max ?? 0) * 1.1)];
}
