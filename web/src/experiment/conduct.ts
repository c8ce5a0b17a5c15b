/** Conducts an experiment in the viewer, and gives everything back afterwards: settings, camera and link. */
import { borrowed, settings } from "../state/app";
import type { Experiment } from "./experiment";
import type { Bench } from "./measure";
import { playsTrace } from "./plan";

export async function conduct(experiment: Experiment, { runner, shaper }: Bench): Promise<void> {
  const person = settings.peek();
  const abandon = () => playsTrace(experiment.plan.network) && shaper?.api.abandon();
  addEventListener("pagehide", abandon);
  borrowed.value = true;
  try {
    await experiment.conduct();
  } finally {
    removeEventListener("pagehide", abandon);
    settings.value = person;
    borrowed.value = false;
    runner.release();
  }
}
