/** Where the latencies of both sides lie, on one logarithmic axis. What draws it is loaded when it is shown. */
import type { ReadonlySignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import type { Columns } from "../network/series";

interface Props {
  readonly name: string;
  readonly columns: ReadonlySignal<Columns>;
}

export function DistributionChart({ name, columns }: Props) {
  const place = useRef<HTMLDivElement>(null);
  const legend = useRef<HTMLElement>(null);
  useEffect(() => {
    let stop: (() => void) | undefined;
    let gone = false;
    void import("./distribution-plot").then(({ plotDistribution }) => {
      if (!gone && place.current && legend.current) stop = plotDistribution(place.current, legend.current, columns);
    });
    return () => {
      gone = true;
      stop?.();
    };
  }, [columns]);
  return (
    <figure class="chart" aria-label={name}>
      <figcaption ref={legend}>
        <span>
          <i class="swatch" data-tone="stateless" />
          Stateless
        </span>
        <span>
          <i class="swatch" data-tone="dash" />
          DASH
        </span>
        <span class="muted">share of inputs, %</span>
      </figcaption>
      <div class="chart-place" ref={place} />
    </figure>
  );
}
