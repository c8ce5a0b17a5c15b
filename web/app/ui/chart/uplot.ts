/** Basis of all charts of the page: uPlot in the page's colours, as wide as its container. Loaded on demand. */
import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import { INTERACTIVE_MS } from "#client/wire/figures";
import { LATENCY_RANGE_MS } from "#viewer/charts/history";

const FONT = "11px system-ui, sans-serif";
const TICKS = [10, 30, 100, 300, 1000, 3000];
/** For a narrow axis, with units in its labels. */
const FEW_TICKS = [10, 100, 1000];

/** Of an axis's name, which is its unit. */
const LABEL = { labelFont: FONT, labelSize: 14, labelGap: 0 };

/** CSS variables of a chart's colours, read at each drawing to follow the theme. */
interface Colours {
  /** Of the legend's swatch number `i`. */
  readonly swatch: (i: number) => CSSStyleDeclaration;
  readonly text: () => string;
  readonly grid: { readonly stroke: () => string; readonly width: number };
}

/** Parts of a chart other than its size, legend and cursor. */
interface ChartOptions extends Pick<uPlot.Options, "padding" | "scales" | "hooks"> {
  readonly height: number;
  readonly axes: readonly uPlot.Axis[];
  /** Of each column after the first. */
  readonly series: readonly uPlot.Series[];
}

/** Draws into `place` in the colours of the legend's swatches and at its width, until disposed of. */
export function createChart(
  place: HTMLElement,
  legend: HTMLElement,
  data: readonly (readonly (number | null)[])[],
  optionsIn: (colours: Colours) => ChartOptions,
): { readonly chart: uPlot; readonly dispose: () => void } {
  const swatches = [...legend.querySelectorAll(".swatch")];
  const colours: Colours = {
    swatch: (i) => getComputedStyle(swatches[i] ?? place),
    text: () => getComputedStyle(place).color,
    grid: { stroke: () => getComputedStyle(place).borderTopColor, width: 1 },
  };
  const { height, axes, series, ...options } = optionsIn(colours);
  const chart = new uPlot(
    {
      width: place.clientWidth,
      height,
      cursor: { show: false },
      legend: { show: false },
      axes: axes.map((axis) => ({
        stroke: colours.text,
        font: FONT,
        gap: 4,
        ticks: { show: false },
        ...LABEL,
        ...axis,
      })),
      series: [{}, ...series.map((one) => ({ points: { show: false }, ...one }))],
      ...options,
    },
    data as uPlot.AlignedData,
    place,
  );
  const observer = new ResizeObserver(() => chart.setSize({ width: place.clientWidth, height }));
  observer.observe(place);
  const dispose = () => {
    observer.disconnect();
    chart.destroy();
  };
  return { chart, dispose };
}

/** Series that are filled below, in the colours of the swatches. */
export function filled({ swatch }: Colours, i: number, stepped: boolean): uPlot.Series {
  const steps = uPlot.paths.stepped?.({ align: 1 });
  return {
    width: 1.5,
    stroke: () => swatch(i).color,
    fill: () => swatch(i).backgroundColor,
    ...(stepped && steps && { paths: steps }),
  };
}

/** The ticks within the axis: uPlot would also draw some outside, with cut labels. */
function reached(ticks: readonly number[]): uPlot.Axis.Splits {
  return (_, __, min, max) => ticks.filter((at) => at >= min && at <= max);
}

/** Latencies on a logarithmic axis. */
export const LATENCY_AXIS: uPlot.Axis = {
  splits: reached(TICKS),
  filter: (_, splits) => splits,
  values: (_, splits) => splits.map((at) => (at < 1000 ? `${at} ms` : `${at / 1000} s`)),
};

/** The same from left to right. */
export const LATENCY_AXIS_BELOW: uPlot.Axis = { ...LATENCY_AXIS, splits: reached(FEW_TICKS) };

/** Shares, in percent. */
export const percent: uPlot.Axis.Values = (_, splits) => splits.map((share) => `${share} %`);

/** Latencies from left to right. */
export const LATENCY_SCALE: uPlot.Scale = { time: false, distr: 3, range: [...LATENCY_RANGE_MS] };

/** A line across the chart at the latency that counts as immediate, of the axis that latencies are on. */
export function interactiveLine(axis: "x" | "y", { text }: Colours): NonNullable<uPlot.Options["hooks"]> {
  const draw = ({ ctx, bbox, valToPos }: uPlot) => {
    const at = Math.round(valToPos(INTERACTIVE_MS, axis, true));
    ctx.save();
    ctx.strokeStyle = text();
    ctx.setLineDash([4, 4]);
    ctx.beginPath();
    ctx.moveTo(axis === "x" ? at : bbox.left, axis === "x" ? bbox.top : at);
    ctx.lineTo(axis === "x" ? at : bbox.left + bbox.width, axis === "x" ? bbox.top + bbox.height : at);
    ctx.stroke();
    ctx.restore();
  };
  return { drawAxes: [draw] };
}
