/** Charts under their captions. The drawing code is loaded with the first chart. */
import type { ReadonlySignal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { useCallback, useEffect, useRef } from "preact/hooks";
import type { Columns } from "#viewer/charts/history";
import { PLACES } from "#viewer/state/settings";
import { milliseconds } from "../format";
import type { Quantity } from "./plots";

interface Props {
  readonly name: string;
  /** Resolves with a function that draws into `place`, in the colours of the legend's swatches, and returns one to stop. */
  readonly load: () => Promise<(place: HTMLElement, legend: HTMLElement) => () => void>;
  readonly children: ComponentChildren;
}

function Chart({ name, load, children }: Props) {
  const place = useRef<HTMLDivElement>(null);
  const caption = useRef<HTMLElement>(null);
  useEffect(() => {
    let stop: (() => void) | undefined;
    let gone = false;
    load().then(
      (draw) => {
        if (!gone && place.current && caption.current) stop = draw(place.current, caption.current);
      },
      () => undefined, // the page reports that it is outdated
    );
    return () => {
      gone = true;
      stop?.();
    };
  }, [load]);
  return (
    <figure class="chart" aria-label={name}>
      <figcaption class="row wrap" ref={caption}>
        {children}
      </figcaption>
      <div class="chart-place" ref={place} />
    </figure>
  );
}

interface LiveProps {
  readonly name: string;
  readonly quantities: readonly Quantity[];
  readonly columns: ReadonlySignal<Columns>;
}

/** The last minute of some quantities. */
export function LiveChart({ name, quantities, columns }: LiveProps) {
  const load = useCallback(async () => {
    const { plotLive } = await import("./plots");
    return (place: HTMLElement, legend: HTMLElement) => plotLive(place, legend, quantities, columns);
  }, [quantities, columns]);
  return (
    <Chart name={name} load={load}>
      {quantities.map(({ label, unit, tone }, i) => (
        <span key={label}>
          <i class="swatch" data-tone={tone} />
          {label} <output>{milliseconds(columns.value[i + 1]?.at(-1))}</output> {unit}
        </span>
      ))}
    </Chart>
  );
}

interface DistributionProps {
  readonly name: string;
  /** Labels of the sides, from left to right. */
  readonly labels: readonly string[];
  readonly columns: ReadonlySignal<Columns>;
}

/** Distribution of the latencies of the pictures on the stage, on one logarithmic axis. */
export function DistributionChart({ name, labels, columns }: DistributionProps) {
  const load = useCallback(async () => {
    const { plotDistribution } = await import("./plots");
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
