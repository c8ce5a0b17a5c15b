/** Conducts an experiment in the viewer, and gives everything back afterwards: settings, camera and link. */
import { settings, settingsOverridden } from "../state/app";
import type { Experiment } from "./experiment";
import type { MeasurementContext } from "./measure";

export async function conduct(experiment: Experiment, { session, runner, shaper }: MeasurementContext): Promise<void> {
  const person = settings.peek();
  const seed = session.seed.peek();
  const abandon = () => experiment.plan.network.trace !== null && shaper?.api.abandon();
  addEventListener("pagehide", abandon);
  settingsOverridden.value = true;
  try {
    await experiment.conduct();
  } finally {
    removeEventListener("pagehide", abandon);
    settings.value = person;
    runner.seed(seed);
    settingsOverridden.value = false;
    runner.release();
  }
}
