/** A chart of an experiment's results; its legend is the table above it. What draws it is loaded when it is shown. */
import type { RefObject } from "preact";
import { useEffect, useRef } from "preact/hooks";
import type { Columns } from "../network/series";

/** The share of inputs that were shown within a time, or the latency over the time of the movement. */
export type ChartKind = "distribution" | "time";

const TITLES: Readonly<Record<ChartKind, string>> = {
  distribution: "Inputs shown within a time, %",
  time: "Median latency over time, ms",
};

interface Props {
  readonly kind: ChartKind;
  readonly columns: Columns;
  /** Has the swatches whose colours the lines have. */
  readonly legend: RefObject<HTMLElement | null>;
}

export function ExperimentChart({ kind, columns, legend }: Props) {
  const place = useRef<HTMLDivElement>(null);
  useEffect(() => {
    let stop: (() => void) | undefined;
    let gone = false;
    void import("./experiment-plot").then(({ plotResults }) => {
      if (!gone && place.current && legend.current) stop = plotResults(place.current, legend.current, kind, columns);
    });
    return () => {
      gone = true;
      stop?.();
    };
  }, [kind, columns, legend]);
  return (
    <figure class="chart" aria-label={TITLES[kind]}>
      <figcaption>{TITLES[kind]}</figcaption>
      <div class="chart-place" ref={place} />
    </figure>
  );
}
