/** Saves the present view as a picture at full quality. */
import { useSignal } from "@preact/signals";
import type { ViewerSession } from "#viewer/session/session";
import { fileName, save } from "../save";

/** How long a failure is shown, in milliseconds. */
const SAID = 6000;

export interface Screenshot {
  readonly busy: boolean;
  /** Why the last one failed; null otherwise. */
  readonly problem: string | null;
  readonly take: () => void;
}

export function useScreenshot(session: ViewerSession | null): Screenshot {
  const busy = useSignal(false);
  const problem = useSignal<string | null>(null);
  const take = async () => {
    if (session === null || busy.peek()) return;
    busy.value = true;
    problem.value = null;
    try {
      const { screenshot } = await import("#viewer/control/screenshot");
      save(fileName(session.scene.peek()?.name ?? "view", "png"), await screenshot(session));
    } catch (error) {
      problem.value = `The picture was not saved. ${error instanceof Error ? error.message : String(error)}`;
      setTimeout(() => {
        problem.value = null;
      }, SAID);
    } finally {
      busy.value = false;
    }
  };
  return { busy: busy.value, problem: problem.value, take: () => void take() };
}
