/** Distribution of the latencies of the pictures on the stage, on one logarithmic axis. */
import type { ReadonlySignal } from "@preact/signals";
import { useCallback } from "preact/hooks";
import type { Columns } from "#viewer/charts/history";
import { PLACES } from "#viewer/state/settings";
import { Chart } from "./chart";

interface Props {
  readonly name: string;
  /** Labels of the sides, from left to right. */
  readonly labels: readonly string[];
  readonly columns: ReadonlySignal<Columns>;
}

export function DistributionChart({ name, labels, columns }: Props) {
  const load = useCallback(async () => {
    const { plotDistribution } = await import("./distribution-plot");
    return (place: HTMLElement, legend: HTMLElement) => plotDistribution(place, legend, columns);
  }, [columns]);
  return (
    <Chart name={name} load={load}>
      {labels.map((label, i) => (
        <span key={PLACES[i]}>
          <i class="swatch" data-tone={PLACES[i]} />
          {label}
        </span>
      ))}
      <span class="muted">share of inputs</span>
    </Chart>
  );
}
