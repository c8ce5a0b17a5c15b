/** Resumes a stored experiment that lacks runs: shows their number, and asks for the movement if necessary. */
import { useSignal } from "@preact/signals";
import type { TargetedSubmitEvent } from "preact";
import type { ResumedExperiment } from "../../experiment/experiment";
import { type ExperimentPlan, networkLabel, runsOf, timeFor } from "../../experiment/plan";
import { MovementError } from "../../movement/movement";
import type { TimedPose } from "../../movement/playback";
import type { ViewerSession } from "../../viewer/session";
import { clock } from "../format";
import { MovementChoice, useMovementOpening, useMovements } from "./experiment-movement";

export interface UnfinishedExperiment extends ResumedExperiment {
  readonly plan: ExperimentPlan;
}

interface Props {
  readonly session: ViewerSession;
  /** The store's URL. */
  readonly store: string | undefined;
  readonly unfinished: UnfinishedExperiment;
  /** With the movement in the scene's own frame. */
  readonly onStart: (points: readonly TimedPose[]) => void;
}

export function ExperimentContinue({ session, store, unfinished: { plan, runs }, onStart }: Props) {
  const chosen = useSignal<string | null>(null);
  const problem = useSignal<string | null>(null);
  const list = useMovements(store);
  const opening = useMovementOpening(store);
  // A recording of an earlier visit had the names that this visit's have.
  const known = list.listed.find(({ origin, name }) => name === plan.movement && origin !== "recording");
  const movement = chosen.value === null ? known : list.listed.find(({ key }) => key === chosen.value);

  const submit = async (event: TargetedSubmitEvent<HTMLFormElement>) => {
    event.preventDefault();
    const scene = session.scene.value;
    if (scene === null || movement?.name !== plan.movement) {
      problem.value =
        scene === null ? "The scene is not there yet." : `Choose ${plan.movement}, the movement of the other runs.`;
      return;
    }
    try {
      const opened = await opening.open(movement, scene);
      if (opened) onStart(opened.points);
    } catch (error) {
      if (!(error instanceof MovementError)) throw error;
      problem.value = error.message;
    }
  };

  return (
    <form class="experiment-form" noValidate onSubmit={(event) => void submit(event)}>
      <p data-wide>
        {runs.length} of {runsOf(plan).length} runs are missing, with the movement {plan.movement} over the network{" "}
        {networkLabel(plan.network)}.
      </p>
      <MovementChoice
        list={list}
        chosen={movement?.key ?? null}
        onChoose={(key) => {
          chosen.value = key;
          problem.value = null;
        }}
        onProblem={(sentence) => {
          problem.value = sentence;
        }}
      />
      <footer>
        <div class="problems" role="alert">
          {problem.value && <p>{problem.value}</p>}
        </div>
        <p class="muted small" data-experiment="estimate">
          About {clock(timeFor(plan, runs.length))} min; the window should be as large as it was.
        </p>
        <button type="submit" class="button" disabled={opening.busy}>
          Continue
        </button>
      </footer>
    </form>
  );
}
