/** Both sides over the last walk and the last minute: how late, how much, how steady and how sharp. Drawn by uPlot, loaded on demand. */

import { useSignal } from "@preact/signals";
import { Fragment } from "preact";
import { useEffect } from "preact/hooks";
import { ComparisonHistory, SIDES } from "../../charts/history";
import { WalkRecorder } from "../../charts/walk";
import { settings } from "../../state/app";
import { STATS_EVERY } from "../../view/meter";
import type { ViewerSession } from "../../viewer/session";
import { DistributionChart } from "../chart/distribution-chart";
import { LiveChart } from "../chart/live-chart";
import type { Quantity } from "../chart/live-plot";
import { LastWalk } from "./last-walk";
import { SIDE_NAMES } from "./names";

const of = (unit: string, stepped: boolean): readonly Quantity[] =>
  SIDES.map((side) => ({ label: SIDE_NAMES[side], unit, axis: "left", tone: side, stepped }));
const CHARTS = [
  { name: "Bandwidth", quantities: of("Mbit/s", false), columns: "bandwidth" },
  { name: "New views", quantities: of("/s", false), columns: "newViews" },
  { name: "Time stalled", quantities: of("s", true), columns: "stalled" },
  { name: "Picture height", quantities: of("px", true), columns: "lines" },
] as const;

export function ComparisonPanel({ session }: { session: ViewerSession }) {
  const records = useRecords(session);
  if (records === null) return null;
  const { history, walks } = records;
  const { mode } = settings.value;
  return (
    <>
      {mode === "side-by-side" && <LastWalk walk={walks.last.value} />}
      <div class="comparison" data-mode={mode}>
        <h4>Motion to photon</h4>
        <DistributionChart name="Motion to photon" columns={history.latency} />
        {CHARTS.map(({ name, quantities, columns }) => (
          <Fragment key={name}>
            <h4>{name}</h4>
            <LiveChart name={name} quantities={quantities} columns={history[columns]} />
          </Fragment>
        ))}
      </div>
    </>
  );
}

interface Records {
  readonly history: ComparisonHistory;
  readonly walks: WalkRecorder;
}

function useRecords(session: ViewerSession): Records | null {
  const current = useSignal<Records | null>(null);
  useEffect(() => {
    const history = new ComparisonHistory();
    const walks = new WalkRecorder();
    current.value = { history, walks };
    const stops = [
      session.rig.onSample(({ seq }, at) => walks.sampled(seq, at)),
      session.onPresented((frame) => {
        history.presented(frame);
        walks.presented(frame);
      }),
    ];
    const timer = setInterval(() => {
      const stateless = settings.peek().mode === "dash" ? null : session.stateless.stats.peek();
      const figures = { stateless, dash: session.dash.peek()?.stats.peek() ?? null };
      history.sample(figures, performance.now());
      walks.sample(figures, performance.now());
    }, STATS_EVERY);
    return () => {
      clearInterval(timer);
      for (const stop of stops) stop();
    };
  }, [session, current]);
  return current.value;
}
