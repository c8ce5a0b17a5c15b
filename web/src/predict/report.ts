/** Errors of predictors as Markdown tables. */
import type { Errors } from "./evaluate";

export interface Row {
  readonly predictor: string;
  /** For each horizon, of each course; every course counts the same. */
  readonly errors: readonly (readonly Errors[])[];
}

/** Mean, median and 95th percentile for each horizon in milliseconds: degrees, and centimetres of movements in metres. */
export function tables(rows: readonly Row[], horizons: readonly number[]): string {
  return [
    table(rows, horizons, "degrees", ({ degrees }) => degrees),
    table(rows, horizons, "centimetres", ({ distance }) => distance.map((metres) => 100 * metres)),
  ].join("\n\n");
}

function table(
  rows: readonly Row[],
  horizons: readonly number[],
  unit: string,
  of: (errors: Errors) => readonly number[],
): string {
  const header = [unit, ...horizons.map((ms) => `${ms} ms`)];
  const body = rows.map(({ predictor, errors }) => [
    predictor,
    ...errors.map((courses) => {
      const figures = [mean, median, percentile95].map((figure) => mean(courses.map((one) => figure(of(one)))));
      return figures.map((value) => value.toFixed(unit === "degrees" ? 2 : 1)).join(" / ");
    }),
  ]);
  const widths = header.map((_, i) => Math.max(...[header, ...body].map((row) => (row[i] ?? "").length)));
  const line = (cells: readonly string[]) => `| ${cells.map((cell, i) => cell.padEnd(widths[i] ?? 0)).join(" | ")} |`;
  return [line(header), `|${widths.map((width) => "-".repeat(width + 2)).join("|")}|`, ...body.map(line)].join("\n");
}

function median(values: readonly number[]): number {
  return percentile(values, 0.5);
}

function percentile95(values: readonly number[]): number {
  return percentile(values, 0.95);
}

/** Nearest rank. */
function percentile(values: readonly number[], rank: number): number {
  const sorted = values.toSorted((a, b) => a - b);
  return sorted[Math.max(0, Math.ceil(rank * sorted.length) - 1)] ?? Number.NaN;
}

function mean(values: readonly number[]): number {
  return values.reduce((sum, value) => sum + value, 0) / values.length;
}
