/** Experiments in the viewer: the dialogue that sets one up and shows what it found, and what is seen while it runs. */
import { computed, type Signal, signal, useSignal } from "@preact/signals";
import { X } from "lucide";
import type { ComponentChildren } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { conduct } from "../experiment/conduct";
import type { Draft } from "../experiment/draft";
import { Experiment } from "../experiment/experiment";
import { measure } from "../experiment/measure";
import type { ExperimentPlan } from "../experiment/plan";
import type { PosePoint } from "../experiment/playback";
import { toJson } from "../experiment/results";
import type { Runner } from "../experiment/runner";
import { fileName, save } from "../experiment/save";
import { StoreApi } from "../experiment/store-api";
import { Shaper } from "../network/shaper";
import type { ViewerSession } from "../player/session";
import { ApiError } from "../state/api";
import { config } from "../state/app";
import { ExperimentForm } from "./experiment-form";
import { ExperimentProgress } from "./experiment-progress";
import { ExperimentResults } from "./experiment-results";
import { IconButton } from "./icon-button";

interface Props {
  readonly session: ViewerSession;
  readonly runner: Runner;
  /** Whether the dialogue is open. */
  readonly open: Signal<boolean>;
  /** Whether a person's input is to be ignored. */
  readonly locked: Signal<boolean>;
}

export interface Wish {
  readonly plan: ExperimentPlan;
  /** The movement, in the scene's own frame. */
  readonly points: readonly PosePoint[];
  readonly locked: boolean;
  readonly exports: boolean;
}

/** The last one, for as long as the page is open: its results outlast a visit to a scene. */
const experiment = signal<Experiment | null>(null);
/** It is under way, or not saved. */
export const experimentAtRisk = computed(
  () => experiment.value !== null && (experiment.value.progress.value !== null || experiment.value.unsaved.value),
);

export function ExperimentLab({ session, runner, open, locked }: Props) {
  const running = experiment.value !== null && experiment.value.progress.value !== null;
  const shaper = useShaper(config.value?.services.shaper, open.value || running);
  const base = config.value?.services.store;
  const store = base === undefined ? null : new StoreApi(base);
  const draft = useSignal<Draft | null>(null);
  useEffect(() => () => experiment.peek()?.cancel(), []);
  useEffect(() => {
    if (open.value) draft.value ??= firstDraft(session);
  }, [open.value, draft, session]);

  const start = async ({ plan, points, locked: lock, exports }: Wish) => {
    const bench = { session, runner, shaper, points };
    const current = new Experiment(plan, new Date().toISOString(), {
      measure: (run, stage, signal) => measure(bench, run, stage, signal),
      store,
      now: () => performance.now(),
    });
    experiment.value = current;
    open.value = false;
    locked.value = lock;
    await conduct(current, bench);
    locked.value = false;
    open.value = true;
    if (exports) await exported(current, store);
  };

  return (
    <>
      <Dialog open={open} title={experiment.value ? experiment.value.plan.name : "Experiment"}>
        {experiment.value !== null && (
          <ExperimentResults
            experiment={experiment.value}
            store={store}
            onExport={() => void (experiment.value && exported(experiment.value, store))}
            onAgain={() => {
              experiment.value = null;
            }}
          />
        )}
        {experiment.value === null && draft.value !== null && (
          <ExperimentForm
            session={session}
            shaper={shaper}
            store={base}
            draft={draft.value}
            onDraft={(filled) => {
              draft.value = filled;
            }}
            onStart={(wish) => void start(wish)}
          />
        )}
      </Dialog>
      {experiment.value && <ExperimentProgress experiment={experiment.value} />}
    </>
  );
}

/** What is filled in before a person does. */
function firstDraft({ scene, movement }: ViewerSession): Draft {
  const chosen = movement.movement.peek();
  return {
    name: scene.peek()?.name ?? "",
    movement: chosen && `${chosen.origin}/${chosen.name}`,
    trace: null,
    rtt: "",
    modes: ["stateless"],
    profiles: ["latency", "budget"],
    repeats: "1",
    duration: "20",
    locked: true,
    exports: false,
  };
}

/** A modal dialogue; what is in it is there only while it is open. */
function Dialog({ open, title, children }: { open: Signal<boolean>; title: string; children: ComponentChildren }) {
  const dialog = useRef<HTMLDialogElement>(null);
  const shown = open.value;
  useEffect(() => {
    if (shown) dialog.current?.showModal();
    else dialog.current?.close();
  }, [shown]);
  const close = () => {
    open.value = false;
  };
  return (
    <dialog ref={dialog} class="experiment" aria-labelledby="experiment-title" onClose={close}>
      <header>
        <h2 id="experiment-title">{title}</h2>
        <IconButton icon={X} label="Close" onClick={close} />
      </header>
      {shown && children}
    </dialog>
  );
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
async function exported(experiment: Experiment, store: StoreApi | null): Promise<void> {
  const { plan, created, results, id, notice, saved } = experiment;
  const name = plan.name;
  if (results.peek().some(({ unstored }) => unstored !== null) || id.peek() === null) {
    save(fileName(name, "json"), new Blob([toJson(plan, created, results.peek())], { type: "application/json" }));
    saved.value = true;
  }
  if (store === null || id.peek() === null) return;
  try {
    save(fileName(name, "zip"), await store.zip(id.peek() ?? ""));
  } catch (error) {
    if (!(error instanceof ApiError)) throw error;
    notice.value = `There is no ZIP: ${error.message}`;
  }
}
