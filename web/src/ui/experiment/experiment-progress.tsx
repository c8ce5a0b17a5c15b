/** Progress of a running experiment: the present run and step, the time left, and a button to cancel. */
import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import type { Experiment } from "../../experiment/experiment";
import { conditionLabel } from "../../experiment/plan";
import { ladder } from "../../state/app";
import { clock } from "../format";

/** Update interval of the time left, in milliseconds. */
const TELL_EVERY = 1000;

export function ExperimentProgress({ experiment }: { experiment: Experiment }) {
  const progress = experiment.progress.value;
  return progress && <Running experiment={experiment} {...progress} />;
}

function Running({
  experiment,
  run,
  of,
  stage,
  startedAt,
  endsAt,
  planned,
}: { experiment: Experiment } & NonNullable<Experiment["progress"]["value"]>) {
  const cancel = useRef<HTMLButtonElement>(null);
  const now = useClock();
  useEffect(() => cancel.current?.focus({ preventScroll: true }), []);
  return (
    <section class="experiment-progress" aria-label="Experiment">
      <p role="status">
        Run {run} of {of} · {conditionLabel(planned, ladder.value)}
        <small class="muted">{stage}</small>
      </p>
      <output>{clock(Math.max(0, endsAt - now))} left</output>
      <button ref={cancel} type="button" class="quiet-button" onClick={() => experiment.cancel()}>
        Cancel
      </button>
      <progress max={endsAt - startedAt} value={now - startedAt} aria-label="Progress of the experiment" />
    </section>
  );
}

function useClock(): number {
  const now = useSignal(performance.now());
  useEffect(() => {
    const timer = setInterval(() => {
      now.value = performance.now();
    }, TELL_EVERY);
    return () => clearInterval(timer);
  }, [now]);
  return now.value;
}
