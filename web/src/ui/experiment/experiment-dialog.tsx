/** Experiments in the viewer: the dialog for setup and results, and the progress display. */

import { computed, type Signal, signal, useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { OFF } from "../../enhance/model/enhancer";
import { conduct } from "../../experiment/conduct";
import type { Draft } from "../../experiment/draft";
import { Experiment, type ExperimentDependencies } from "../../experiment/experiment";
import { measure } from "../../experiment/measure";
import { toJson } from "../../experiment/results";
import type { Runner } from "../../experiment/runner";
import { uploadSamples } from "../../experiment/sample-upload";
import { StoreApi } from "../../experiment/store-api";
import { Shaper } from "../../network/shaper";
import { config, settings } from "../../state/app";
import type { ViewerSession } from "../../viewer/session";
import { Dialog } from "../dialog";
import { download, fileName, save } from "../save";
import { ExperimentContinue, type UnfinishedExperiment } from "./experiment-continue";
import type { ExperimentSetup } from "./experiment-form";
import { ExperimentForm } from "./experiment-form";
import { keyOf } from "./experiment-movement";
import { ExperimentProgress } from "./experiment-progress";
import { ExperimentResults } from "./experiment-results";

interface Props {
  readonly session: ViewerSession;
  readonly runner: Runner;
  /** Whether the dialog is open. */
  readonly open: Signal<boolean>;
  /** Whether a person's input is to be ignored. */
  readonly locked: Signal<boolean>;
}

/** The last experiment of this page: its results survive a change of scene. */
const experiment = signal<Experiment | null>(null);
/** The experiment to resume, in its own scene. */
const unfinished = signal<UnfinishedExperiment | null>(null);
/** Running, or not saved. */
export const experimentAtRisk = computed(
  () => experiment.value !== null && (experiment.value.progress.value !== null || experiment.value.unsaved.value),
);

/** Goes on with an experiment of the store as soon as its scene is opened; results that are not saved are shown first. */
export function continueExperiment(wanted: UnfinishedExperiment): void {
  if (!experimentAtRisk.peek()) experiment.value = null;
  unfinished.value = wanted;
}

export function ExperimentDialog({ session, runner, open, locked }: Props) {
  const running = experiment.value !== null && experiment.value.progress.value !== null;
  const shaper = useShaper(config.value?.services.shaper, open.value || running);
  const base = config.value?.services.store;
  const store = base === undefined ? null : new StoreApi(base);
  const draft = useSignal<Draft | null>(null);
  const rest = unfinished.value?.plan.scene === session.scene.value?.id ? unfinished.value : null;
  useEffect(() => () => experiment.peek()?.cancel(), []);
  const { name = "" } = session.scene.value ?? {};
  useEffect(() => {
    if (open.value) draft.value ??= initialDraft(session);
    if (draft.value?.name === "") draft.value = { ...draft.value, name }; // the scene may come after the dialog was opened
  }, [open.value, draft, session, name]);
  useEffect(() => {
    if (rest) open.value = true;
  }, [rest, open]);

  const start = async ({ plan, points, locked: lock, exportAtEnd, resumed }: ExperimentSetup) => {
    const experimentOf = () => ({ name: plan.name, plan, experiment: current.id.peek() });
    const context = { session, runner, shaper, points, experiment: experimentOf };
    const dependencies: ExperimentDependencies = {
      measure: (run, stage, signal) => measure(context, run, stage, signal),
      store,
      sampled: () => runner.sampled,
      uploadSamples: async (key, place, progress, signal) => {
        if (store) await uploadSamples({ key, place, store, progress, signal });
      },
      now: () => performance.now(),
    };
    const current = new Experiment(plan, new Date().toISOString(), dependencies, resumed);
    unfinished.value = null;
    experiment.value = current;
    open.value = false;
    locked.value = lock;
    try {
      await conduct(current, context);
    } finally {
      locked.value = false;
      open.value = true;
    }
    if (exportAtEnd) exportResults(current, store);
  };
  const shown = experiment.value ?? rest;
  const close = () => {
    open.value = false;
    unfinished.value = null;
  };

  return (
    <>
      {open.value && (
        <Dialog title={shown ? shown.plan.name : "Experiment"} kind="experiment" onClose={close}>
          {experiment.value !== null && (
            <ExperimentResults
              experiment={experiment.value}
              store={store}
              onExport={() => experiment.value && exportResults(experiment.value, store)}
              onAgain={() => {
                experiment.value = null;
              }}
            />
          )}
          {experiment.value === null && rest !== null && (
            <ExperimentContinue
              session={session}
              store={base}
              unfinished={rest}
              onStart={(points) =>
                void start({ plan: rest.plan, points, locked: true, exportAtEnd: false, resumed: rest })
              }
            />
          )}
          {experiment.value === null && rest === null && draft.value !== null && (
            <ExperimentForm
              session={session}
              shaper={shaper}
              store={base}
              draft={draft.value}
              onDraft={(filled) => {
                draft.value = filled;
              }}
              onStart={(setup) => void start(setup)}
            />
          )}
        </Dialog>
      )}
      {experiment.value && <ExperimentProgress experiment={experiment.value} />}
    </>
  );
}

/** Initial values of the form: reprojection and prediction as in the viewer. */
function initialDraft({ scene, movement, unturned }: ViewerSession): Draft {
  const chosen = movement.movement.peek();
  const { reprojection, prediction, overscan, depth, surround } = settings.peek();
  return {
    name: scene.peek()?.name ?? "",
    movement: chosen && keyOf(chosen),
    trace: null,
    rtt: "",
    modes: ["stateless"],
    profiles: ["latency", "budget"],
    frameRate: null,
    restore: OFF,
    upscale: OFF,
    reprojection: reprojection && unturned.peek() === null,
    prediction,
    overscan,
    depth,
    surround,
    segments: "1",
    repeats: "1",
    duration: "20",
    seed: "1",
    stride: "0",
    locked: true,
    exportAtEnd: false,
  };
}

/** The shaper, if usable. */
function useShaper(base: string | undefined, wanted: boolean): Shaper | null {
  const shaper = useSignal<Shaper | null>(null);
  useEffect(() => {
    if (base === undefined || !wanted) return undefined;
    const current = new Shaper(base, location.href, () => performance.now());
    shaper.value = current;
    return () => {
      shaper.value = null;
      current.dispose();
    };
  }, [base, wanted, shaper]);
  return shaper.value;
}

/** Saves the store's archive, and a separate file with everything not in the store. */
function exportResults({ plan, created, results, id, saved }: Experiment, store: StoreApi | null): void {
  const kept = id.peek();
  if (results.peek().some(({ unstored }) => unstored !== null) || kept === null) {
    const json = toJson(plan, created, results.peek());
    save(fileName(plan.name, "json"), new Blob([json], { type: "application/json" }));
    saved.value = true;
  }
  if (store !== null && kept !== null) download(store.zipUrl(kept));
}
