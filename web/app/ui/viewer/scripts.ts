/** `window.tigas` for a visit and, in a frame, messages of the page around it. */
import { offerBridge } from "#lab/experiment/bridge";
import { Runner } from "#lab/experiment/runner";
import { ViewerControl } from "#viewer/control/viewer-control";
import { answerParent } from "#viewer/embed/frame-messages";
import type { ViewerSession } from "#viewer/session/session";

/** Offers both; returns a function that withdraws them. */
export function offer(session: ViewerSession): () => void {
  const runner = new Runner(session);
  const withdraw = offerBridge(runner);
  const control = new ViewerControl(session);
  const leaveParent = answerParent(control);
  return () => {
    withdraw();
    leaveParent();
    control.destroy();
    runner.dispose();
  };
}
