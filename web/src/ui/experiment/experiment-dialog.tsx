/** Experiments in the viewer: the dialogue that sets one up and shows what it found, and what is seen while it runs. */

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
import { config } from "../../state/app";
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
  /** Whether the dialogue is open. */
  readonly open: Signal<boolean>;
  /** Whether a person's input is to be ignored. */
  readonly locked: Signal<boolean>;
}

/** The last one, for as long as the page is open: its results outlast a visit to a scene. */
const experiment = signal<Experiment | null>(null);
/** What a person wants to go on with, in its own scene. */
const unfinished = signal<UnfinishedExperiment | null>(null);
/** It is under way, or not saved. */
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
  useEffect(() => {
    if (open.value) draft.value ??= initialDraft(session);
  }, [open.value, draft, session]);
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
    await conduct(current, context);
    locked.value = false;
    open.value = true;
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

/** What is filled in before a person does. */
function initialDraft({ scene, movement }: ViewerSession): Draft {
  const chosen = movement.movement.peek();
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
    reprojection: false,
    prediction: OFF,
    overscan: "auto",
    depth: true,
    surround: true,
    segments: "1",
    repeats: "1",
    duration: "20",
    seed: "1",
    stride: "0",
    locked: true,
    exportAtEnd: false,
  };
}

/** The shaper, for as long as it is of use. */
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

/** Saves the store's archive, and in a file of its own whatever the store does not have. */
function exportResults({ plan, created, results, id, saved }: Experiment, store: StoreApi | null): void {
  const kept = id.peek();
  if (results.peek().some(({ unstored }) => unstored !== null) || kept === null) {
    const json = toJson(plan, created, results.peek());
    save(fileName(plan.name, "json"), new Blob([json], { type: "application/json" }));
    saved.value = true;
  }
  if (store !== null && kept !== null) download(store.zipUrl(kept));
}
