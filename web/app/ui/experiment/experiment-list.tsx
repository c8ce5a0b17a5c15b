/** All experiments in the store, newest first, with their reports and archives. */

import { Download, FileText, Images, Play, Trash2 } from "lucide";
import { useCallback, useEffect, useMemo, useState } from "preact/hooks";
import type { ExperimentSummary } from "#client/wire/store";
import { StoreApi } from "#lab/experiment/store-api";
import { config } from "../../state/app";
import { runHash, samplesHash } from "../../state/route";
import { Icon, IconButton } from "../button";
import { useAttempts, usePage } from "../hooks";
import { Notice } from "../notice";
import { Question } from "../question";
import { TopBar } from "../top-bar";
import { LocalSamples } from "./local-samples";
import { dateOf, Table } from "./table";

export function ExperimentList() {
  const base = config.value?.services.store;
  /** Counter of samples uploaded to the store. */
  const [uploads, setUploads] = useState(0);
  usePage("Experiments");
  return (
    <div class="dashboard">
      <TopBar>
        <a href="#/">Scenes</a>
      </TopBar>
      <main>
        <div class="page-head">
          <h1>Experiments</h1>
        </div>
        {base ? (
          <StoredExperiments key={uploads} base={base} />
        ) : (
          config.value && <p>This server has no experiment store.</p>
        )}
        <LocalSamples
          store={base === undefined ? null : new StoreApi(base)}
          onUploaded={() => setUploads((count) => count + 1)}
        />
      </main>
    </div>
  );
}

function StoredExperiments({ base }: { base: string }) {
  const [list, setList] = useState<readonly ExperimentSummary[]>();
  const [unwanted, setUnwanted] = useState<ExperimentSummary>();
  const { problem, attempt } = useAttempts();
  const store = useMemo(() => new StoreApi(base), [base]);
  const look = useCallback(() => attempt(async () => setList(await store.list())), [store, attempt]);
  useEffect(() => void look(), [look]);
  if (list === undefined && problem.value === null) return <p class="muted">Loading experiments…</p>;
  if (list?.length === 0)
    return <p>No experiments yet. To start one, open a scene and choose Experiment… in the lab, or press X.</p>;
  return (
    <>
      <Notice>{problem.value}</Notice>
      {list && (
        <Table columns={["Name", "Complete runs", null]}>
          {list.map((one) => (
            <Row key={one.id} store={store} experiment={one} onDelete={setUnwanted} />
          ))}
        </Table>
      )}
      {unwanted && (
        <Question
          title={`Delete “${unwanted.name}”?`}
          verb="Delete"
          action={() => store.remove(unwanted.id)}
          onDone={() => void look()}
          onClose={() => setUnwanted(undefined)}
        >
          <p>
            Its {unwanted.runs === 1 ? "run" : `${unwanted.runs} runs`} from {dateOf(unwanted.created)} and all their
            samples will be deleted from the server’s disk. This cannot be undone.
          </p>
        </Question>
      )}
    </>
  );
}

interface RowProps {
  readonly store: StoreApi;
  readonly experiment: ExperimentSummary;
  readonly onDelete: (experiment: ExperimentSummary) => void;
}

function Row({ store, experiment, onDelete }: RowProps) {
  const { id, name, created, source, planned, runs, complete, sampled } = experiment;
  const unfinished = complete < (planned ?? 0);
  const of = planned ?? runs;
  return (
    <tr>
      <th scope="row">
        <a href={store.reportUrl(id)} target="_blank" rel="noreferrer">
          {name}
        </a>
        <time class="muted small" dateTime={created}>
          {dateOf(created)}
        </time>
      </th>
      <td>
        {complete < of ? `${complete} of ${of}` : complete}
        {unfinished && ", incomplete"}
      </td>
      <td>
        {unfinished && source === "page" && (
          <a class="with-icon" href={runHash(id)}>
            <Icon of={Play} size={14} /> Continue
          </a>
        )}
        {sampled > 0 && (
          <a class="with-icon" href={samplesHash(id)}>
            <Icon of={Images} size={14} /> Samples
          </a>
        )}
        <a class="with-icon" href={store.reportUrl(id)} target="_blank" rel="noreferrer">
          <Icon of={FileText} size={14} /> Report
        </a>
        <a class="with-icon" href={store.zipUrl(id)} download>
          <Icon of={Download} size={14} /> ZIP
        </a>
        <IconButton icon={Trash2} label={`Delete ${name}`} onClick={() => onDelete(experiment)} />
      </td>
    </tr>
  );
}
