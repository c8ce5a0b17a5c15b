/** Both sides over the last minute: how late, how much, how steady and how sharp. Drawn by uPlot, loaded on demand. */

import { useSignal } from "@preact/signals";
import { Fragment } from "preact";
import { useEffect } from "preact/hooks";
import { ComparisonHistory, SIDES } from "../../charts/history";
import { settings } from "../../state/app";
import { STATS_EVERY } from "../../view/meter";
import type { Side } from "../../view/presented";
import type { ViewerSession } from "../../viewer/session";
import { DistributionChart } from "../chart/distribution-chart";
import { LiveChart } from "../chart/live-chart";
import type { Quantity } from "../chart/live-plot";

const NAMES: Readonly<Record<Side, string>> = { stateless: "Stateless", dash: "DASH" };

const of = (unit: string, stepped: boolean): readonly Quantity[] =>
  SIDES.map((side) => ({ label: NAMES[side], unit, axis: "left", tone: side, stepped }));
const CHARTS = [
  { name: "Bandwidth", quantities: of("Mbit/s", false), columns: "bandwidth" },
  { name: "New views", quantities: of("/s", false), columns: "newViews" },
  { name: "Time stalled", quantities: of("s", true), columns: "stalled" },
  { name: "Picture height", quantities: of("px", true), columns: "lines" },
] as const;

export function ComparisonPanel({ session }: { session: ViewerSession }) {
  const history = useHistory(session);
  return (
    history && (
      <div class="comparison" data-mode={settings.value.mode}>
        <h4>Motion to photon</h4>
        <DistributionChart name="Motion to photon" columns={history.latency} />
        {CHARTS.map(({ name, quantities, columns }) => (
          <Fragment key={name}>
            <h4>{name}</h4>
            <LiveChart name={name} quantities={quantities} columns={history[columns]} />
          </Fragment>
        ))}
      </div>
    )
  );
}

function useHistory(session: ViewerSession): ComparisonHistory | null {
  const current = useSignal<ComparisonHistory | null>(null);
  useEffect(() => {
    const history = new ComparisonHistory();
    current.value = history;
    const stop = session.onPresented((frame) => history.presented(frame));
    const timer = setInterval(() => {
      const stateless = settings.peek().mode === "dash" ? null : session.stateless.stats.peek();
      history.sample({ stateless, dash: session.dash.peek()?.stats.peek() ?? null }, performance.now());
    }, STATS_EVERY);
    return () => {
      clearInterval(timer);
      stop();
    };
  }, [session, current]);
  return current.value;
}
