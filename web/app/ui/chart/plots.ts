/** Drawing of charts: uPlot in the page's colours, as wide as its container. Loaded on demand. */
import { effect, type ReadonlySignal } from "@preact/signals";
import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import { INTERACTIVE_MS } from "#client/wire/figures";
import { type Columns, LATENCY_RANGE_MS, SPAN_S } from "#viewer/charts/history";

const FONT = "11px system-ui, sans-serif";
const HEIGHT = 128;
/** Ticks of the axis of latencies. */
const TICKS = [10, 100, 1000];
/** Style of an axis's label, which is its unit. */
const LABEL = { labelFont: FONT, labelSize: 14, labelGap: 0 };

/** CSS variables of a chart's colours, read at each drawing to follow the theme. */
interface Colours {
  /** Style of the legend's swatch number `i`. */
  readonly swatch: (i: number) => CSSStyleDeclaration;
  readonly text: () => string;
  readonly grid: { readonly stroke: () => string; readonly width: number };
}

/** Parts of a chart other than its size, legend and cursor. */
interface ChartOptions extends Pick<uPlot.Options, "padding" | "scales" | "hooks"> {
  readonly axes: readonly uPlot.Axis[];
  /** One for each column after the first. */
  readonly series: readonly uPlot.Series[];
}

/** Draws into `place` in the colours of the legend's swatches and at its width; returns a function that stops. */
function draw(
  place: HTMLElement,
  legend: HTMLElement,
  columns: ReadonlySignal<Columns>,
  optionsIn: (colours: Colours) => ChartOptions,
): () => void {
  const swatches = [...legend.querySelectorAll(".swatch")];
  const colours: Colours = {
    swatch: (i) => getComputedStyle(swatches[i] ?? place),
    text: () => getComputedStyle(place).color,
    grid: { stroke: () => getComputedStyle(place).borderTopColor, width: 1 },
  };
  const { axes, series, ...options } = optionsIn(colours);
  const usual = { stroke: colours.text, font: FONT, gap: 4, ticks: { show: false }, ...LABEL };
  const chart = new uPlot(
    {
      width: place.clientWidth,
      height: HEIGHT,
      cursor: { show: false },
      legend: { show: false },
      axes: axes.map((axis) => ({ ...usual, ...axis })),
      series: [{}, ...series.map((one) => ({ points: { show: false }, ...one }))],
      ...options,
    },
    columns.peek() as uPlot.AlignedData,
    place,
  );
  const observer = new ResizeObserver(() => chart.setSize({ width: place.clientWidth, height: HEIGHT }));
  observer.observe(place);
  const stop = effect(() => chart.setData(columns.value as uPlot.AlignedData));
  return () => {
    stop();
    observer.disconnect();
    chart.destroy();
  };
}

/** Series that are filled below, in the colours of the swatches. */
function filled({ swatch }: Colours, i: number, stepped: boolean): uPlot.Series {
  const steps = uPlot.paths.stepped?.({ align: 1 });
  return {
    width: 1.5,
    stroke: () => swatch(i).color,
    fill: () => swatch(i).backgroundColor,
    ...(stepped && steps && { paths: steps }),
  };
}

export interface Quantity {
  readonly label: string;
  readonly unit: string;
  /** Name of the axis; quantities with the same unit share it. */
  readonly axis: "left" | "right";
  readonly tone: "target" | "measured" | "second" | "left" | "right";
  /** Each value holds until the next one. */
  readonly stepped?: boolean;
}

/** The last minute of some quantities. */
export function plotLive(
  place: HTMLElement,
  legend: HTMLElement,
  quantities: readonly Quantity[],
  columns: ReadonlySignal<Columns>,
): () => void {
  const sides = [...new Set(quantities.map(({ axis }) => axis))];
  const range: uPlot.Scale["range"] = (_, __, max) => [0, Math.max(1, (max ?? 0) * 1.1)];
  return draw(place, legend, columns, (colours) => ({
    padding: [8, sides.includes("right") ? 0 : 12, 0, 0],
    scales: {
      x: { time: false, range: (_, __, max) => [max - SPAN_S, max] },
      ...Object.fromEntries(sides.map((side) => [side, { range }])),
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
}

/** The distribution of latencies, with a line where interaction begins to feel slow. */
export function plotDistribution(
  place: HTMLElement,
  legend: HTMLElement,
  columns: ReadonlySignal<Columns>,
): () => void {
  const sides = columns.peek().slice(1);
  return draw(place, legend, columns, (colours) => ({
    padding: [8, 12, 0, 0],
    scales: {
      x: { time: false, distr: 3, range: [...LATENCY_RANGE_MS] },
      y: { range: (_, __, max) => [0, Math.max(20, max ?? 0)] },
    },
    axes: [
      {
        // uPlot would also draw ticks outside the axis, with clipped labels.
        splits: (_, __, min, max) => TICKS.filter((at) => at >= min && at <= max),
        filter: (_, splits) => splits,
        values: (_, splits) => splits.map((at) => (at < 1000 ? `${at} ms` : `${at / 1000} s`)),
        size: 24,
        grid: { show: false },
      },
      { values: (_, splits) => splits.map((share) => `${share} %`), size: 42, space: 28, grid: colours.grid },
    ],
    series: sides.map((_, i) => filled(colours, i, true)),
    hooks: {
      drawAxes: [
        ({ ctx, bbox, valToPos }) => {
          const x = Math.round(valToPos(INTERACTIVE_MS, "x", true));
          ctx.save();
          ctx.strokeStyle = colours.text();
          ctx.setLineDash([4, 4]);
          ctx.beginPath();
          ctx.moveTo(x, bbox.top);
          ctx.lineTo(x, bbox.top + bbox.height);
          ctx.stroke();
          ctx.restore();
        },
      ],
    },
  }));
}
