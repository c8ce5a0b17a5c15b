/** A chart of the last minute with its legend. */
import type { ReadonlySignal } from "@preact/signals";
import { useCallback } from "preact/hooks";
import type { Columns } from "#viewer/charts/history";
import { Chart } from "./chart";
import type { Quantity } from "./live-plot";

interface Props {
  readonly name: string;
  readonly quantities: readonly Quantity[];
  readonly columns: ReadonlySignal<Columns>;
}

export function LiveChart({ name, quantities, columns }: Props) {
  const load = useCallback(async () => {
    const { plotLive } = await import("./live-plot");
    return (place: HTMLElement, legend: HTMLElement) => plotLive(place, legend, quantities, columns);
  }, [quantities, columns]);
  const latest = columns.value.slice(1).map((column) => column.at(-1) ?? null);
  return (
    <Chart name={name} load={load}>
      {quantities.map(({ label, unit, tone }, i) => (
        <span key={label}>
          <i class="swatch" data-tone={tone} />
          {label} <output>{number(latest[i])}</output> {unit}
        </span>
      ))}
    </Chart>
  );
}

function number(value: number | null | undefined): string {
  if (value === null || value === undefined) return "–";
  return value < 10 ? value.toFixed(1) : String(Math.round(value));
}
