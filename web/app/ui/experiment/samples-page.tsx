/** The samples of a stored experiment, run by run with their pictures, and rendered again on request. */
import { useSignal } from "@preact/signals";
import { useCallback, useEffect, useMemo, useState } from "preact/hooks";
import { ApiError } from "#client/http/problem";
import type { Materialisation, RunRow, SampleList, Experiment as StoredExperiment } from "#client/wire/store";
import { StoreApi } from "#lab/experiment/store-api";
import { config } from "../../state/app";
import { EXPERIMENTS } from "../../state/route";
import { useAttempts, usePage } from "../hooks";
import { Notice } from "../notice";
import { TopBar } from "../top-bar";
import { SampleGallery } from "./sample-gallery";
import { Table } from "./table";

/** Polling interval of the store's progress, in milliseconds. */
const ASK_EVERY = 1000;

export function SamplesPage({ id }: { id: string }) {
  const base = config.value?.services.store;
  usePage("Samples");
  return (
    <div class="dashboard">
      <TopBar>
        <a href={EXPERIMENTS}>Experiments</a>
      </TopBar>
      <main>
        {base ? <Samples base={base} id={id} /> : config.value && <p>This server has no experiment store.</p>}
      </main>
    </div>
  );
}

function Samples({ base, id }: { base: string; id: string }) {
  const store = useMemo(() => new StoreApi(base), [base]);
  const [experiment, setExperiment] = useState<StoredExperiment>();
  const [chosen, setChosen] = useState<string>();
  const { problem, attempt } = useAttempts();
  const rendering = useAttempts();
  const refresh = useCallback(() => attempt(async () => setExperiment(await store.get(id))), [attempt, store, id]);
  useEffect(() => void refresh(), [refresh]);
  const runs = experiment?.runs.filter(({ samples }) => samples !== null) ?? [];
  const run = runs.find(({ folder }) => folder === chosen) ?? runs[0];
  return (
    <>
      <div class="page-head row wrap spread">
        <h1>{experiment?.name ?? "Samples"}</h1>
        <Rendering store={store} id={id} attempt={rendering.attempt} onProgress={refresh} />
      </div>
      <Notice>{problem.value ?? rendering.problem.value}</Notice>
      {experiment && runs.length === 0 && <p>No run of this experiment has samples.</p>}
      {run && (
        <>
          <p class="small muted">Each frame was requested again; identical frames match byte for byte.</p>
          <Runs runs={runs} chosen={run.folder} onChoose={setChosen} />
          <Run key={run.folder} run={run} store={store} id={id} />
        </>
      )}
    </>
  );
}

interface RenderingProps {
  readonly store: StoreApi;
  readonly id: string;
  readonly attempt: ReturnType<typeof useAttempts>["attempt"];
  /** Called whenever more samples have been rendered. */
  readonly onProgress: () => Promise<unknown>;
}

/** Progress of rendering the samples again, with buttons to start and stop it. */
function Rendering({ store, id, attempt, onProgress }: RenderingProps) {
  const state = useSignal<Materialisation | null>(null);
  const take = useCallback(
    (method?: "POST" | "DELETE") =>
      attempt(async () => {
        const before = state.value;
        const told = await store.materialisation(id, method);
        state.value = told;
        if (told.problem) throw new ApiError(told.problem, false);
        if (before && (before.done !== told.done || before.state !== told.state)) await onProgress();
      }),
    [attempt, state, onProgress, store, id],
  );
  const running = state.value?.state === "running";
  useEffect(() => {
    if (!running) {
      void take();
      return;
    }
    const timer = setInterval(() => void take(), ASK_EVERY);
    return () => clearInterval(timer);
  }, [running, take]);
  if (state.value === null || state.value.total === 0) return null;
  const { done, total } = state.value;
  return (
    <div class="sample-choice row wrap">
      {running ? (
        <>
          <progress max={total} value={done} aria-label="Rendering ground truth" />
          <output>
            {done} of {total}
          </output>
          <button type="button" class="button quiet" onClick={() => void take("DELETE")}>
            Stop
          </button>
        </>
      ) : (
        <>
          <span class="muted small">
            {done} of {total} have ground truth
          </span>
          {done < total && (
            <button type="button" class="button" onClick={() => void take("POST")}>
              Render ground truth
            </button>
          )}
        </>
      )}
    </div>
  );
}

interface RunsProps {
  readonly runs: readonly RunRow[];
  readonly chosen: string;
  readonly onChoose: (folder: string) => void;
}

function Runs({ runs, chosen, onChoose }: RunsProps) {
  return (
    <Table columns={["Run", "Samples", "Identical", "Different", "Incomplete"]}>
      {runs.map(
        ({ folder, samples }) =>
          samples && (
            <tr key={folder}>
              <th scope="row">
                <label>
                  <input type="radio" name="run" checked={folder === chosen} onChange={() => onChoose(folder)} />{" "}
                  {folder}
                </label>
              </th>
              <td>{samples.samples}</td>
              <td>{samples.identical}</td>
              <td class={samples.different > 0 ? "sample-warning" : undefined}>{samples.different}</td>
              <td>{samples.missing}</td>
            </tr>
          ),
      )}
    </Table>
  );
}

function Run({ run: { folder, samples }, store, id }: { run: RunRow; store: StoreApi; id: string }) {
  const [list, setList] = useState<SampleList>();
  const { problem, attempt } = useAttempts();
  const load = useCallback((name: string) => store.picture(id, folder, name), [store, id, folder]);
  // A change of the counts means new figures.
  const known = JSON.stringify(samples);
  // biome-ignore lint/correctness/useExhaustiveDependencies: fetched again when `known` changes
  useEffect(() => {
    void attempt(async () => setList(await store.samples(id, folder)));
  }, [known, store, id, folder, attempt]);
  return (
    <>
      <Notice>{problem.value ?? list?.problem}</Notice>
      {list && <SampleGallery samples={list.samples} load={load} />}
    </>
  );
}
