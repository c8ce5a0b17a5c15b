/** Runs an experiment of the store in this page: the view, the progress, and the report at the end. */

import { type Signal, useSignal } from "@preact/signals";
import { Download, FileText, Images } from "lucide";
import { useEffect, useRef } from "preact/hooks";
import type { RunJob } from "#client/wire/store";
import { Conductor, type Ending } from "#lab/experiment/conductor";
import { type Performed, perform } from "#lab/experiment/perform";
import { Runner } from "#lab/experiment/runner";
import { StoreApi } from "#lab/experiment/store-api";
import { Shaper } from "#lab/network/shaper";
import { ViewerSession } from "#viewer/session/session";
import { DEFAULT_SETTINGS } from "#viewer/state/settings";
import { config, page, settings, settingsOverridden } from "../../state/app";
import { EXPERIMENTS, samplesHash } from "../../state/route";
import { Icon, QuietButton } from "../button";
import { clock } from "../format";
import { useLeavingWarning, usePage } from "../hooks";
import { TopBar } from "../top-bar";

export function RunPage({ id }: { id: string }) {
  const base = config.value?.services.store;
  usePage("Experiment");
  return (
    <div class="run-page">
      <TopBar>
        <a href={EXPERIMENTS}>Experiments</a>
      </TopBar>
      {base !== undefined && <Performing id={id} store={base} shaper={config.value?.services.shaper} />}
      {config.value && base === undefined && <p>This server has no experiment store.</p>}
    </div>
  );
}

interface PerformingProps {
  readonly id: string;
  /** URLs of the services. */
  readonly store: string;
  readonly shaper: string | undefined;
}

function Performing({ id, store: base, shaper: shaperBase }: PerformingProps) {
  const stage = useRef<HTMLDivElement>(null);
  const conductor = useSignal<Conductor | null>(null);
  /** Counts attempts; the second and later ones accept changed versions. */
  const attempt = useSignal(0);
  useEffect(() => {
    const shaper = shaperBase === undefined ? null : new Shaper(shaperBase, location.href);
    const current = new Conductor(id, {
      store: new StoreApi(base),
      perform: (job, say, signal) => performOn(stage.current, { job, shaper, experiment: id, say, signal }),
      page: crypto.randomUUID(),
    });
    conductor.value = current;
    const person = settings.peek();
    const release = () => current.release();
    addEventListener("pagehide", release);
    settingsOverridden.value = true;
    void awake(current.conduct(attempt.value > 0)).finally(() => shaper?.dispose());
    return () => {
      removeEventListener("pagehide", release);
      current.cancel();
      settings.value = person;
      settingsOverridden.value = false;
    };
  }, [id, base, shaperBase, conductor, attempt.value]);
  const { ending, notices } = conductor.value ?? {};
  useLeavingWarning(conductor.value !== null && ending?.value === null);
  return (
    <>
      <div class="run-stage" ref={stage} inert hidden={ending?.value != null} />
      <main class="run-panel stack">
        <h1 class="visually-hidden">Experiment</h1>
        {conductor.value && ending?.value === null && <ProgressPanel conductor={conductor.value} />}
        {ending?.value && <EndPanel id={id} store={new StoreApi(base)} ending={ending.value} attempt={attempt} />}
        {notices && notices.value.length > 0 && (
          <ul class="experiment-remarks small">
            {notices.value.map((notice) => (
              <li key={notice}>{notice}</li>
            ))}
          </ul>
        )}
      </main>
    </>
  );
}

interface Job {
  readonly job: RunJob;
  readonly shaper: Shaper | null;
  readonly experiment: string;
  readonly say: (step: string) => void;
  readonly signal: AbortSignal;
}

/** Makes a run in a new visit, on a stage of the run's size that is scaled to fit. */
async function performOn(place: HTMLElement | null, { job, shaper, experiment, say, signal }: Job): Promise<Performed> {
  if (place === null) throw new Error("There is no place for the view.");
  const { scene, width, height } = job.configuration;
  const [element, left, right] = ["stage", "pane", "pane"].map((name) => {
    const made = document.createElement("div");
    made.className = name;
    return made;
  }) as [HTMLDivElement, HTMLDivElement, HTMLDivElement];
  element.append(left, right);
  Object.assign(element.style, { width: `${width}px`, height: `${height}px` });
  place.replaceChildren(element);
  const fit = () => {
    const scale = Math.min(1, place.clientWidth / width, place.clientHeight / height);
    element.style.transform = `translate(-50%, -50%) scale(${scale})`;
  };
  const observer = new ResizeObserver(fit);
  observer.observe(place);
  settings.value = { ...DEFAULT_SETTINGS, theme: settings.peek().theme };
  const session = new ViewerSession(scene, { element, left, right }, page);
  const runner = new Runner(session);
  try {
    return await perform(job, { session, runner, shaper, experiment, stage: say, signal });
  } finally {
    observer.disconnect();
    runner.dispose();
    session.dispose();
    place.replaceChildren();
  }
}

/** Keeps the screen on during `work`, where the browser can: with its screen off, a phone gets no animation frames. */
async function awake(work: Promise<void>): Promise<void> {
  const over = new AbortController();
  let lock: WakeLockSentinel | undefined;
  const keep = async () => {
    lock = await navigator.wakeLock?.request("screen").catch(() => undefined);
    if (over.signal.aborted) await lock?.release();
  };
  document.addEventListener("visibilitychange", () => void keep(), { signal: over.signal }); // a hidden page loses the lock
  await keep();
  await work.finally(() => {
    over.abort();
    void lock?.release();
  });
}

function ProgressPanel({ conductor }: { conductor: Conductor }) {
  const { title, stage, planned, missing, remaining_s } = conductor.progress.value;
  const done = planned - missing;
  return (
    <section class="experiment-progress" aria-label="Experiment">
      <p role="status">
        {title === null ? "Experiment" : `Run ${done + 1} of ${planned} · ${title}`}
        <small class="muted">{stage}</small>
      </p>
      <output>about {clock(remaining_s * 1000)} left</output>
      <QuietButton onClick={() => conductor.cancel()}>Cancel</QuietButton>
      <progress max={Math.max(1, planned)} value={done} aria-label="Experiment progress" />
    </section>
  );
}

interface EndProps {
  readonly id: string;
  readonly store: StoreApi;
  readonly ending: Ending;
  readonly attempt: Signal<number>;
}

function EndPanel({ id, store, ending: { problem, refused, missing, sampled }, attempt }: EndProps) {
  return (
    <section class="run-end row wrap" aria-label="Experiment">
      <p role="status">
        {problem ??
          (missing === 0
            ? "All runs are complete."
            : `${missing === 1 ? "One run is" : `${missing} runs are`} incomplete.`)}
      </p>
      {missing !== 0 && (
        <button type="button" class="button quiet" onClick={() => attempt.value++}>
          {refused ? "Continue anyway" : "Continue"}
        </button>
      )}
      <a class="button quiet with-icon" href={store.zipUrl(id)} download>
        <Icon of={Download} size={16} /> Save as ZIP
      </a>
      {sampled && (
        <a class="button quiet with-icon" href={samplesHash(id)}>
          <Icon of={Images} size={16} /> Samples
        </a>
      )}
      <a class="button with-icon" href={store.reportUrl(id)} target="_blank" rel="noreferrer">
        <Icon of={FileText} size={16} /> Report
      </a>
    </section>
  );
}
