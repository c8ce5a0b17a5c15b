/** A chart of the last minute with its legend. What draws it is loaded when the first chart is shown. */
import type { ReadonlySignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import type { Columns } from "../network/series";

export interface Quantity {
  readonly label: string;
  readonly unit: string;
  /** Whose axis it has: quantities of one unit share one. */
  readonly axis: "left" | "right";
  readonly tone: "target" | "measured" | "second" | "stateless" | "dash";
  /** Each value holds until the next one. */
  readonly stepped?: boolean;
}

interface Props {
  readonly name: string;
  readonly quantities: readonly Quantity[];
  readonly columns: ReadonlySignal<Columns>;
}

export function LiveChart({ name, quantities, columns }: Props) {
  const place = useRef<HTMLDivElement>(null);
  const legend = useRef<HTMLElement>(null);
  useEffect(() => {
    let stop: (() => void) | undefined;
    let gone = false;
    void import("./plot").then(({ plot }) => {
      if (!gone && place.current && legend.current) stop = plot(place.current, legend.current, quantities, columns);
    });
    return () => {
      gone = true;
      stop?.();
    };
  }, [quantities, columns]);
  const latest = columns.value.slice(1).map((column) => column.at(-1) ?? null);
  return (
    <figure class="chart" aria-label={name}>
      <figcaption ref={legend}>
        {quantities.map(({ label, unit, tone }, i) => (
          <span key={label}>
            <i class="swatch" data-tone={tone} />
            {label} <output>{number(latest[i])}</output> {unit}
          </span>
        ))}
      </figcaption>
      <div class="chart-place" ref={place} />
    </figure>
  );
}

function number(value: number | null | undefined): string {
  if (value === null || value === undefined) return "–";
  return value < 10 ? value.toFixed(1) : String(Math.round(value));
}
