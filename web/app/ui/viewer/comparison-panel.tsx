/** The pictures on the stage over the last walk and the last minute: latency, data, stalls and sharpness. Drawn by uPlot, loaded on demand. */

import { Fragment } from "preact";
import { useState } from "preact/hooks";
import type { Comparison } from "#viewer/session/comparison";
import type { ViewerSession } from "#viewer/session/session";
import { kindsShown, sideTitles } from "#viewer/sources/sides";
import { PLACES } from "#viewer/state/settings";
import { settings } from "../../state/app";
import { DistributionChart, LiveChart } from "../chart/chart";
import { LastWalk } from "./last-walk";

const CHARTS = [
  { name: "Bandwidth", unit: "Mbit/s", stepped: false, columns: "bandwidth" },
  { name: "New views", unit: "/s", stepped: false, columns: "newViews" },
  { name: "Time stalled", unit: "s", stepped: true, columns: "stalled" },
  { name: "Picture height", unit: "px", stepped: true, columns: "lines" },
  { name: "Buffer", unit: "ms", stepped: false, columns: "buffered" },
] as const;

export function ComparisonPanel({ session }: { session: ViewerSession }) {
  const comparison = session.comparison.value;
  const names = sideTitles(settings.value);
  if (comparison === null || comparison.sides.length !== names.length) return null;
  return <Charts key={names.join()} names={names} comparison={comparison} />;
}

interface Props {
  readonly names: readonly string[];
  readonly comparison: Comparison;
}

function Charts({ names, comparison }: Props) {
  const [charts] = useState(() => chartsOf(names));
  const { sides, history, walks, quality } = comparison;
  return (
    <>
      {sides.length > 1 && (
        <LastWalk
          names={names}
          walk={walks.last.value}
          quality={quality.value}
          local={kindsShown(settings.value).map(({ drawsHere }) => drawsHere)}
        />
      )}
      <div class="stack">
        <h4>Motion to photon</h4>
        <DistributionChart name="Motion to photon" labels={names} columns={history.latency} />
        {charts.map(({ name, quantities, columns }) => (
          <Fragment key={name}>
            <h4>{name}</h4>
            <LiveChart name={name} quantities={quantities} columns={history.series[columns]} />
          </Fragment>
        ))}
      </div>
    </>
  );
}

function chartsOf(names: readonly string[]) {
  const sides = names.flatMap((label, i) => (PLACES[i] ? [{ label, tone: PLACES[i], axis: "left" as const }] : []));
  return CHARTS.map(({ unit, stepped, ...chart }) => ({
    ...chart,
    quantities: sides.map((side) => ({ ...side, unit, stepped })),
  }));
}
