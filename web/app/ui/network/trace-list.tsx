/** The traces to choose from, each with a small plot of its rate towards the client. */

import type { TracePoints, TraceSummary } from "#client/wire/shaper";
import { stepPath } from "#lab/network/series";
import { bitrate, clock } from "../format";

interface Props {
  readonly traces: readonly TraceSummary[];
  readonly plots: ReadonlyMap<string, TracePoints>;
  readonly chosen: string | null;
  readonly onChoose: (name: string) => void;
}

const BOX: [number, number] = [72, 24];

export function TraceList({ traces, plots, chosen, onChoose }: Props) {
  return (
    <fieldset class="rungs traces">
      <legend class="visually-hidden">Trace</legend>
      {traces.map(({ name, error, mean_down_kbps = 0, duration_ms = 0 }) => (
        <label key={name} title={error ?? undefined}>
          <input
            type="radio"
            name="trace"
            checked={name === chosen}
            disabled={Boolean(error)}
            onChange={() => onChoose(name)}
          />
          <span class="trace-name">
            {name}
            <span class="muted">{error ?? `${bitrate(mean_down_kbps * 1000)} · ${clock(duration_ms)}`}</span>
          </span>
          <TraceOutline points={plots.get(name)} />
        </label>
      ))}
    </fieldset>
  );
}

function TraceOutline({ points }: { points: TracePoints | undefined }) {
  const [width, height] = BOX;
  return (
    <svg class="trace-plot" aria-hidden="true" viewBox={`0 -1 ${width} ${height + 2}`} width={width} height={height}>
      {points && <path d={stepPath(points.times_ms, points.down_kbps, points.duration_ms, BOX)} />}
    </svg>
  );
}
