/** The samples of an experiment that the store keeps: rendered again when asked, run by run, with their pictures. */
import { type Signal, useSignal } from "@preact/signals";
import { useCallback, useEffect, useMemo } from "preact/hooks";
import { ApiError } from "#client/http/problem";
import type { Materialisation, RunRow, SampleList, Experiment as StoredExperiment } from "#client/wire/store";
import { StoreApi } from "#lab/experiment/store-api";
import { config, refreshScenes } from "../../state/app";
import { EXPERIMENTS } from "../../state/route";
import { TopBar } from "../top-bar";
import { SampleGallery } from "./sample-gallery";

/** Polling interval of the store's progress, in milliseconds. */
const ASK_EVERY = 1000;

export function SamplesPage({ id }: { id: string }) {
  const base = config.value?.services.store;
  useEffect(() => {
    document.title = "Samples · TIGAS";
    void refreshScenes();
  }, []);
  return (
    <div class="dashboard">
      <TopBar>
        <a href={EXPERIMENTS}>Experiments</a>
      </TopBar>
      <main>
        {base ? <Samples base={base} id={id} /> : config.value && <p>This server has no store of experiments.</p>}
      </main>
    </div>
  );
}

function Samples({ base, id }: { base: string; id: string }) {
  const store = useMemo(() => new StoreApi(base), [base]);
  const experiment = useSignal<StoredExperiment | null>(null);
  const problem = useSignal<string | null>(null);
  const chosen = useSignal<string | null>(null);
  const attempt = useAttempt(problem);
  const refresh = useCallback(
    () =>
      attempt(async () => {
        experiment.value = await store.get(id);
      }),
    [attempt, store, id, experiment],
  );
  useEffect(() => void refresh(), [refresh]);
  const runs = experiment.value?.runs.filter(({ samples }) => samples !== null) ?? [];
  const run = runs.find(({ folder }) => folder === chosen.value) ?? runs[0];
  return (
    <>
      <div class="page-head">
        <h1>{experiment.value?.name ?? "Samples"}</h1>
        <Rendering store={store} id={id} problem={problem} onProgress={refresh} />
      </div>
      {problem.value && (
        <p class="notice" role="alert">
          {problem.value}
        </p>
      )}
      {experiment.value && runs.length === 0 && <p>No run of this experiment has samples.</p>}
      {run && (
        <>
          <p class="small muted">Each frame was requested again; identical frames match byte for byte.</p>
          <Runs
            runs={runs}
            chosen={run.folder}
            onChoose={(folder) => {
              chosen.value = folder;
            }}
          />
          <Run key={run.folder} run={run} store={store} id={id} />
        </>
      )}
    </>
  );
}

interface RenderingProps {
  readonly store: StoreApi;
  readonly id: string;
  readonly problem: Signal<string | null>;
  /** Whenever more is rendered. */
  readonly onProgress: () => Promise<void>;
}

/** How far rendering the samples again is, with the buttons that begin and end it. */
function Rendering({ store, id, problem, onProgress }: RenderingProps) {
  const state = useSignal<Materialisation | null>(null);
  const attempt = useAttempt(problem);
  const take = useCallback(
    (ask: () => Promise<Materialisation>) =>
      attempt(async () => {
        const before = state.value;
        const told = await ask();
        state.value = told;
        if (told.problem) problem.value = told.problem;
        if (before && (before.done !== told.done || before.state !== told.state)) await onProgress();
      }),
    [attempt, state, problem, onProgress],
  );
  const running = state.value?.state === "running";
  useEffect(() => {
    if (!running) {
      void take(() => store.materialisation(id));
      return;
    }
    const timer = setInterval(() => void take(() => store.materialisation(id)), ASK_EVERY);
    return () => clearInterval(timer);
  }, [running, store, id, take]);
  if (state.value === null || state.value.total === 0) return null;
  const { done, total } = state.value;
  return (
    <div class="sample-choice">
      {running ? (
        <>
          <progress max={total} value={done} aria-label="Samples that are rendered again" />
          <output>
            {done} of {total}
          </output>
          <button type="button" class="button quiet" onClick={() => void take(() => store.stopMaterialising(id))}>
            Stop
          </button>
        </>
      ) : (
        <>
          <span class="muted small">
            {done} of {total} have ground truth
          </span>
          {done < total && (
            <button
              type="button"
              class="button"
              onClick={() => {
                problem.value = null;
                void take(() => store.materialise(id));
              }}
            >
              Render ground truth
            </button>
          )}
        </>
      )}
    </div>
  );
}

function Runs({
  runs,
  chosen,
  onChoose,
}: {
  runs: readonly RunRow[];
  chosen: string;
  onChoose: (folder: string) => void;
}) {
  return (
    <div class="experiment-list sampled-runs">
      <table>
        <thead>
          <tr>
            <th scope="col">Run</th>
            <th scope="col">Samples</th>
            <th scope="col">Identical</th>
            <th scope="col">Different</th>
            <th scope="col">Incomplete</th>
          </tr>
        </thead>
        <tbody>
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
        </tbody>
      </table>
    </div>
  );
}

function Run({ run: { folder, samples }, store, id }: { run: RunRow; store: StoreApi; id: string }) {
  const list = useSignal<SampleList | null>(null);
  const problem = useSignal<string | null>(null);
  const attempt = useAttempt(problem);
  const load = useCallback((name: string) => store.picture(id, folder, name), [store, id, folder]);
  // A change of the counts means new figures.
  const known = JSON.stringify(samples);
  // biome-ignore lint/correctness/useExhaustiveDependencies: asked again when `known` changes
  useEffect(() => {
    void attempt(async () => {
      list.value = await store.samples(id, folder);
    });
  }, [known, store, id, folder, attempt, list]);
  const said = problem.value ?? list.value?.problem;
  return (
    <>
      {said && (
        <p class="notice" role="alert">
          {said}
        </p>
      )}
      {list.value && <SampleGallery samples={list.value.samples} load={load} />}
    </>
  );
}

/** Runs something, and keeps the sentence of an ApiError. */
function useAttempt(problem: Signal<string | null>): (what: () => Promise<void>) => Promise<void> {
  return useCallback(
    async (what) => {
      try {
        await what();
      } catch (error) {
        if (!(error instanceof ApiError)) throw error;
        problem.value = error.message;
      }
    },
    [problem],
  );
}
