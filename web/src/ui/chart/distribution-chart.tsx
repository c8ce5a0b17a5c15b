/** Where the latencies of both sides lie, on one logarithmic axis. */
import type { ReadonlySignal } from "@preact/signals";
import { useCallback } from "preact/hooks";
import type { Columns } from "../../charts/columns";
import { Chart } from "./chart";

interface Props {
  readonly name: string;
  readonly columns: ReadonlySignal<Columns>;
}

export function DistributionChart({ name, columns }: Props) {
  const load = useCallback(async () => {
    const { plotDistribution } = await import("./distribution-plot");
    return (place: HTMLElement, legend: HTMLElement) => plotDistribution(place, legend, columns);
  }, [columns]);
  return (
    <Chart name={name} load={load}>
      <span>
        <i class="swatch" data-tone="stateless" />
        Stateless
      </span>
      <span>
        <i class="swatch" data-tone="dash" />
        DASH
      </span>
      <span class="muted">share of inputs, %</span>
    </Chart>
  );
}
