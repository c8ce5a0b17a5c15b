/** A chart of an experiment's results; its legend is the table above it. */

import type { RefObject } from "preact";
import { useCallback } from "preact/hooks";
import type { Columns } from "../../charts/columns";
import { Chart } from "../chart/chart";
import type { ChartKind } from "./experiment-plot";

const TITLES: Readonly<Record<ChartKind, string>> = {
  distribution: "Inputs shown within a time",
  time: "Median latency over time",
};

interface Props {
  readonly kind: ChartKind;
  readonly columns: Columns;
  /** Element with the swatches that colour the lines. */
  readonly legend: RefObject<HTMLElement | null>;
}

export function ExperimentChart({ kind, columns, legend }: Props) {
  const load = useCallback(async () => {
    const { plotResults } = await import("./experiment-plot");
    return (place: HTMLElement, swatches: HTMLElement) => plotResults(place, swatches, kind, columns);
  }, [kind, columns]);
  return (
    <Chart name={TITLES[kind]} load={load} legend={legend}>
      {TITLES[kind]}
    </Chart>
  );
}
