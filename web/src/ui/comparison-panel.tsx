/** Both sides over the last minute: how late, how much, how steady and how sharp. Drawn by uPlot, loaded on demand. */
import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { ComparisonHistory } from "../comparison/history";
import { STATS_EVERY } from "../player/player";
import type { ViewerSession } from "../player/session";
import { settings } from "../state/app";
import { DistributionChart } from "./distribution-chart";
import { LiveChart, type Quantity } from "./live-chart";

const both = (unit: string, stepped: boolean): readonly Quantity[] => [
  { label: "Stateless", unit, axis: "left", tone: "stateless", stepped },
  { label: "DASH", unit, axis: "left", tone: "dash", stepped },
];
const BANDWIDTH = both("Mbit/s", false);
const STALLED = both("s", true);
const LINES = both("px", true);

export function ComparisonPanel({ session }: { session: ViewerSession }) {
  const history = useHistory(session);
  return (
    history && (
      <div class="comparison">
        <h4>Motion to photon</h4>
        <DistributionChart name="Motion to photon" columns={history.latency} />
        <h4>Bandwidth</h4>
        <LiveChart name="Bandwidth" quantities={BANDWIDTH} columns={history.bandwidth} />
        <h4>Time stalled</h4>
        <LiveChart name="Time stalled" quantities={STALLED} columns={history.stalled} />
        <h4>Picture height</h4>
        <LiveChart name="Picture height" quantities={LINES} columns={history.lines} />
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
      const stateless = settings.peek().mode === "dash" ? null : session.player.stats.peek();
      history.sample({ stateless, dash: session.dash.peek()?.stats.peek() ?? null }, performance.now());
    }, STATS_EVERY);
    return () => {
      clearInterval(timer);
      stop();
    };
  }, [session, current]);
  return current.value;
}
