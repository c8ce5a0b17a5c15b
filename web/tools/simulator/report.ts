/** Results of many simulated visits as a table. */
import { INTERACTIVE_MS } from "#client/wire/figures";
import type { Figures } from "./tally";

export interface Run {
  readonly trace: string;
  readonly controller: string;
  /** Round trip in milliseconds; null for the trace's own delay. */
  readonly roundTrip: number | null;
  readonly figures: Figures;
}

const COLUMNS: readonly (readonly [string, (figures: Figures) => string])[] = [
  [`poses ≤ ${INTERACTIVE_MS} ms`, ({ inTime }) => percent(inTime)],
  [`frames ≤ ${INTERACTIVE_MS} ms`, ({ responsesInTime }) => percent(responsesInTime)],
  ["response p50", ({ responseP50 }) => responseP50.toFixed(0)],
  ["p95, ms", ({ responseP95 }) => responseP95.toFixed(0)],
  ["photon p50", ({ photonP50 }) => photonP50.toFixed(0)],
  ["p95, ms", ({ photonP95 }) => photonP95.toFixed(0)],
  ["view, dB", ({ viewPsnr }) => viewPsnr.toFixed(2)],
  ["view MSE", ({ viewError }) => viewError.toFixed(0)],
  ["SSIM", ({ viewSsim }) => viewSsim.toFixed(4)],
  ["content age, ms", ({ contentAge }) => contentAge.toFixed(0)],
  ["mean rung", ({ rungOverTime }) => rungOverTime.toFixed(2)],
  ["switches/min", ({ switches }) => switches.toFixed(1)],
  ["frames/s", ({ framesPerSecond }) => framesPerSecond.toFixed(1)],
  ["Mbit/s", ({ bandwidth }) => bandwidth.toFixed(1)],
  ["stalls/min", ({ stalls }) => stalls.toFixed(1)],
];

/** A Markdown table of all runs, in the order given. */
export function table(runs: readonly Run[]): string {
  const header = ["trace", "RTT", "controller", ...COLUMNS.map(([title]) => title)];
  const rows = runs.map(({ trace, roundTrip, controller, figures }) => [
    trace,
    roundTrip === null ? "trace's" : String(roundTrip),
    controller,
    ...COLUMNS.map(([, show]) => show(figures)),
  ]);
  const widths = header.map((title, i) =>
    Math.max(...[title, ...rows.map((row) => row[i] ?? "")].map((s) => s.length)),
  );
  const line = (cells: readonly string[]) => `| ${cells.map((cell, i) => cell.padEnd(widths[i] ?? 0)).join(" | ")} |`;
  return [line(header), `|${widths.map((width) => "-".repeat(width + 2)).join("|")}|`, ...rows.map(line)].join("\n");
}

/** For each round trip and controller, the mean of each figure over all traces, equally weighted. */
export function overTraces(runs: readonly Run[]): Run[] {
  const first = new Map(runs.toReversed().map((run) => [`${run.roundTrip} ${run.controller}`, run]));
  return [...first.values()].toReversed().map((one) => {
    const group = runs.filter((run) => run.roundTrip === one.roundTrip && run.controller === one.controller);
    const names = Object.keys(one.figures) as (keyof Figures)[];
    const mean = (name: keyof Figures) => group.reduce((sum, { figures }) => sum + figures[name], 0) / group.length;
    const figures = Object.fromEntries(names.map((name) => [name, mean(name)])) as unknown as Figures;
    return { ...one, trace: `all ${group.length}`, figures };
  });
}

function percent(share: number): string {
  return `${(share * 100).toFixed(1)} %`;
}
