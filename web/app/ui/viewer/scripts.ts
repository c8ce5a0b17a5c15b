/** `window.tigas` for a visit. */
import { offerBridge } from "#lab/experiment/bridge";
import { Runner } from "#lab/experiment/runner";
import type { ViewerSession } from "#viewer/session/session";

/** Offers it until the function that this returns is called. */
export function offer(session: ViewerSession): () => void {
  const runner = new Runner(session);
  const withdraw = offerBridge(runner);
  return () => {
    withdraw();
    runner.dispose();
  };
}
