/** All experiments that the store keeps, the newest first, with their reports and archives. */

import { useSignal } from "@preact/signals";
import { Download, FileText, Images, Play, Trash2 } from "lucide";
import { useCallback, useEffect } from "preact/hooks";
import { ApiError } from "#client/http/problem";
import type { ExperimentSummary } from "#client/wire/store";
import { StoreApi } from "#lab/experiment/store-api";
import { config, refreshScenes } from "../../state/app";
import { runHash, samplesHash } from "../../state/route";
import { Icon } from "../icon";
import { IconButton } from "../icon-button";
import { Question } from "../question";
import { TopBar } from "../top-bar";
import { LocalSamples } from "./local-samples";

export function ExperimentList() {
  const base = config.value?.services.store;
  /** Counter of samples uploaded to the store. */
  const uploads = useSignal(0);
  useEffect(() => {
    document.title = "Experiments · TIGAS";
    void refreshScenes();
  }, []);
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
          <StoredExperiments key={uploads.value} base={base} />
        ) : (
          config.value && <p>This server has no store of experiments.</p>
        )}
        <LocalSamples
          store={base === undefined ? null : new StoreApi(base)}
          onUploaded={() => {
            uploads.value++;
          }}
        />
      </main>
    </div>
  );
}

function StoredExperiments({ base }: { base: string }) {
  const list = useSignal<readonly ExperimentSummary[] | null>(null);
  const problem = useSignal<string | null>(null);
  const unwanted = useSignal<ExperimentSummary | null>(null);
  const store = new StoreApi(base);
  const look = useCallback(async () => {
    try {
      list.value = await new StoreApi(base).list();
      problem.value = null;
    } catch (error) {
      problem.value = error instanceof ApiError ? error.message : "The list cannot be read.";
    }
  }, [base, list, problem]);
  useEffect(() => void look(), [look]);
  if (list.value === null && problem.value === null) return <p class="muted">Asking the store…</p>;
  if (list.value?.length === 0)
    return <p>No experiments yet. To start one, open a scene and choose Experiment in the toolbar, or press X.</p>;
  return (
    <>
      {problem.value && (
        <p class="notice" role="alert">
          {problem.value}
        </p>
      )}
      {list.value && (
        <Table
          store={store}
          list={list.value}
          onDelete={(experiment) => {
            unwanted.value = experiment;
          }}
        />
      )}
      {unwanted.value && (
        <DeleteQuestion
          store={store}
          experiment={unwanted.value}
          onDone={() => void look()}
          onClose={() => {
            unwanted.value = null;
          }}
        />
      )}
    </>
  );
}

interface DeleteProps {
  readonly store: StoreApi;
  readonly experiment: ExperimentSummary;
  readonly onDone: () => void;
  readonly onClose: () => void;
}

function DeleteQuestion({ store, experiment, onDone, onClose }: DeleteProps) {
  const { id, name, created, runs } = experiment;
  return (
    <Question
      title={`Delete “${name}”?`}
      verb="Delete"
      action={() => store.remove(id)}
      onDone={onDone}
      onClose={onClose}
    >
      <p>
        Its {runs === 1 ? "run" : `${runs} runs`} of {dateOf(created)} and all of their samples are deleted from the
        server’s disk. This cannot be undone.
      </p>
    </Question>
  );
}

function dateOf(created: string): string {
  return new Date(created).toLocaleString("en", { dateStyle: "medium", timeStyle: "short" });
}

interface TableProps {
  readonly store: StoreApi;
  readonly list: readonly ExperimentSummary[];
  readonly onDelete: (experiment: ExperimentSummary) => void;
}

function Table({ store, list, onDelete }: TableProps) {
  return (
    <div class="experiment-list">
      <table>
        <thead>
          <tr>
            <th scope="col">Name</th>
            <th scope="col">Complete runs</th>
            <th scope="col">
              <span class="visually-hidden">Files</span>
            </th>
          </tr>
        </thead>
        <tbody>
          {list.map((one) => (
            <Row key={one.id} store={store} experiment={one} onDelete={onDelete} />
          ))}
        </tbody>
      </table>
    </div>
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
