/** Errors of predictors as a Markdown table. */
import type { Errors } from "./evaluate";

export interface Row {
  readonly predictor: string;
  /** For each horizon, of each course; every course counts the same. */
  readonly errors: readonly (readonly Errors[])[];
}

/** Median and 95th percentile, degrees and centimetres (of movements in metres), for each horizon in milliseconds. */
export function table(rows: readonly Row[], horizons: readonly number[]): string {
  const header = ["predictor", ...horizons.flatMap((ms) => [`${ms} ms: °`, "p95", "cm", "p95"])];
  const body = rows.map(({ predictor, errors }) => [
    predictor,
    ...horizons.flatMap((_, i) => {
      const of = (kind: keyof Errors, rank: number, scale: number) =>
        mean((errors[i] ?? []).map((one) => scale * percentile(one[kind], rank))).toFixed(kind === "degrees" ? 2 : 1);
      return [of("degrees", 0.5, 1), of("degrees", 0.95, 1), of("distance", 0.5, 100), of("distance", 0.95, 100)];
    }),
  ]);
  const widths = header.map((_, i) => Math.max(...[header, ...body].map((row) => (row[i] ?? "").length)));
  const line = (cells: readonly string[]) => `| ${cells.map((cell, i) => cell.padEnd(widths[i] ?? 0)).join(" | ")} |`;
  return [line(header), `|${widths.map((width) => "-".repeat(width + 2)).join("|")}|`, ...body.map(line)].join("\n");
}

function percentile(values: readonly number[], rank: number): number {
  const sorted = values.toSorted((a, b) => a - b);
  return sorted[Math.max(0, Math.ceil(rank * sorted.length) - 1)] ?? Number.NaN;
}

function mean(values: readonly number[]): number {
  return values.reduce((sum, value) => sum + value, 0) / values.length;
}
