/** Conducts an experiment in the viewer, and gives everything back afterwards: settings, camera and link. */
import { borrowed, settings } from "../state/app";
import type { Experiment } from "./experiment";
import type { Bench } from "./measure";

export async function conduct(experiment: Experiment, { runner, shaper }: Bench): Promise<void> {
  const person = settings.peek();
  const shaped = experiment.plan.network.trace !== null;
  const leaving = new AbortController();
  const { signal } = leaving;
  addEventListener("beforeunload", (event) => event.preventDefault(), { signal });
  addEventListener("pagehide", () => shaped && shaper?.api.abandon(), { signal });
  borrowed.value = true;
  try {
    await experiment.conduct();
  } finally {
    leaving.abort();
    settings.value = person;
    borrowed.value = false;
    runner.release();
  }
}
