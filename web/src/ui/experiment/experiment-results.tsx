/** Results of an experiment: figures per controller and mode, latency charts, and links to the records. */

import { useSignal } from "@preact/signals";
import { Download, FileText } from "lucide";
import type { RefObject } from "preact";
import { useMemo, useRef } from "preact/hooks";
import type { Experiment } from "../../experiment/experiment";
import { looksOf } from "../../experiment/looks";
import { conditionLabel } from "../../experiment/plan";
import {
  type ConditionSummary,
  cumulativeDistribution,
  medianOverTime,
  type RunResult,
  summarize,
} from "../../experiment/results";
import type { StoreApi } from "../../experiment/store-api";
import { ladder } from "../../state/app";
import { EXPERIMENTS } from "../../state/route";
import { INTERACTIVE_MS } from "../../wire/figures";
import { Icon } from "../icon";
import { ExperimentChart } from "./experiment-chart";

interface Props {
  readonly experiment: Experiment;
  readonly store: StoreApi | null;
  readonly onExport: () => void;
  readonly onAgain: () => void;
}

export function ExperimentResults({ experiment, store, onExport, onAgain }: Props) {
  const legend = useRef<HTMLTableElement>(null);
  const results = experiment.results.value;
  const columns = useMemo(
    () => ({ distribution: cumulativeDistribution(results), time: medianOverTime(results) }),
    [results],
  );
  const measured = results.some(({ inputLatencies }) => inputLatencies.length > 0);
  const id = experiment.id.value;
  const running = experiment.progress.value !== null;
  const storing = useSignal(false);
  const storeAgain = async () => {
    storing.value = true;
    await experiment.store();
    storing.value = false;
  };
  return (
    <div>
      {experiment.cancelled && <p class="notice">It was cancelled; what was finished before is here.</p>}
      {experiment.notice.value && (
        <p class="notice" role="alert">
          {experiment.notice.value}
        </p>
      )}
      <Figures rows={summarize(results)} legend={legend} />
      {measured && (
        <div class="experiment-charts">
          <ExperimentChart kind="distribution" columns={columns.distribution} legend={legend} />
          <ExperimentChart kind="time" columns={columns.time} legend={legend} />
        </div>
      )}
      <Remarks results={results} />
      {!running && (
        <footer>
          <button type="button" class="button quiet" onClick={onAgain}>
            {experiment.unsaved.value ? "Discard and start over" : "New experiment"}
          </button>
          {store && results.some(({ unstored }) => unstored !== null) && (
            <button type="button" class="button quiet" disabled={storing.value} onClick={() => void storeAgain()}>
              Store again
            </button>
          )}
          {store && id !== null && (
            <>
              <a class="button quiet" href={EXPERIMENTS}>
                All experiments
              </a>
              <a class="button quiet with-icon" href={store.reportUrl(id)} target="_blank" rel="noreferrer">
                <Icon of={FileText} size={16} /> Report
              </a>
            </>
          )}
          <button type="button" class="button with-icon" onClick={onExport}>
            <Icon of={Download} size={16} /> {id === null ? "Save as JSON" : "Save as ZIP"}
          </button>
        </footer>
      )}
    </div>
  );
}

const COLUMNS = [
  { title: "View latency p50", unit: "ms", of: "viewP50", digits: 0, factor: 1 },
  { title: "View latency p95", unit: "ms", of: "viewP95", digits: 0, factor: 1 },
  { title: "Motion-to-photon p50", unit: "ms", of: "p50", digits: 0, factor: 1 },
  { title: "p90", unit: "ms", of: "p90", digits: 0, factor: 1 },
  { title: "p95", unit: "ms", of: "p95", digits: 0, factor: 1 },
  { title: "p99", unit: "ms", of: "p99", digits: 0, factor: 1 },
  { title: `≤ ${INTERACTIVE_MS} ms`, unit: "%", of: "interactive", digits: 0, factor: 100 },
  { title: "a frame less", unit: "%", of: "interactiveFrameLess", digits: 0, factor: 100 },
  { title: "a frame more", unit: "%", of: "interactiveFrameMore", digits: 0, factor: 100 },
  { title: "Content age", unit: "ms", of: "contentAge", digits: 0, factor: 1 },
  { title: "New views", unit: "/s", of: "newViewsPerSecond", digits: 1, factor: 1 },
  { title: "Height", unit: "px", of: "meanHeight", digits: 0, factor: 1 },
  { title: "Switches", unit: "", of: "switches", digits: 1, factor: 1 },
  { title: "Received", unit: "Mbit/s", of: "received", digits: 1, factor: 1e-6 },
] as const;

function Figures({ rows, legend }: { rows: readonly ConditionSummary[]; legend: RefObject<HTMLTableElement | null> }) {
  const columns = COLUMNS.filter(({ of }) => rows.some(({ figures }) => figures[of] !== null));
  const looks = looksOf(rows.map(({ run }) => run));
  return (
    <div class="experiment-table">
      <table ref={legend}>
        <caption class="visually-hidden">
          Means over the complete runs of each controller and mode; latency is from motion to photon
        </caption>
        <thead>
          <tr>
            <th scope="col">Controller or mode</th>
            <th scope="col">Runs</th>
            {columns.map(({ title, unit }) => (
              <th key={title} scope="col">
                {title} <span class="muted">{unit}</span>
              </th>
            ))}
          </tr>
        </thead>
        <tbody>
          {rows.map(({ run, runs, complete, figures }, i) => (
            <tr key={conditionLabel(run)}>
              <th scope="row">
                <i class="swatch" data-series style={{ color: looks[i]?.colour, borderStyle: looks[i]?.line }} />
                {conditionLabel(run, ladder.value)}
              </th>
              <td>{complete === runs ? runs : `${complete} of ${runs}`}</td>
              {columns.map(({ of, digits, factor }) => (
                <td key={of} data-figure={of}>
                  {shown(figures[of], factor, digits)}
                </td>
              ))}
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}

/** Notices about single runs. */
function Remarks({ results }: { results: readonly RunResult[] }) {
  const remarks = results.flatMap(({ run, problem, samplesProblem, hidden, saturatedShare }, i) => {
    const said = [
      problem,
      saturatedShare == null
        ? null
        : `The machine was out of processor time for ${Math.round(100 * saturatedShare)} % of the run, so the latencies include its delays.`,
      samplesProblem,
      hidden ? "The page was hidden, so that the browser may have held frames back." : null,
    ];
    const name = conditionLabel(run, ladder.value);
    return said.flatMap((sentence) => (sentence === null ? [] : `Run ${i + 1}, ${name}: ${sentence}`));
  });
  if (remarks.length === 0) return null;
  return (
    <ul class="experiment-remarks">
      {remarks.map((remark) => (
        <li key={remark}>{remark}</li>
      ))}
    </ul>
  );
}

function shown(value: number | null, factor: number, digits: number): string {
  return value === null ? "–" : (value * factor).toFixed(digits);
}
