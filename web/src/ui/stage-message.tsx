/** What the stage has to say: what is awaited, that the server is away, or why there is no picture. */
import { CircleAlert, LoaderCircle, Unplug } from "lucide";
import type { ViewerSession } from "../player/session";
import { Icon } from "./icon";

export function StageMessage({ session }: { session: ViewerSession }) {
  const phase = session.phase.value;
  const problem = session.player.problem.value;
  return (
    <div class="stage-message" role="status">
      {(phase.kind === "connecting" || phase.kind === "loading") && (
        <p class="floating message">
          <span class="spinner">
            <Icon of={LoaderCircle} />
          </span>
          {phase.kind === "loading" ? "Loading the scene…" : "Connecting…"}
        </p>
      )}
      {phase.kind === "lost" && (
        <p class="floating message" data-tone="warning">
          <Icon of={Unplug} />
          <span>{phase.message} Trying again…</span>
        </p>
      )}
      {phase.kind === "failed" && (
        <div class="floating message tall" data-tone="danger">
          <Icon of={CircleAlert} />
          <p>{phase.message}</p>
          <div class="message-actions">
            <button type="button" class="button" onClick={() => session.retry()}>
              Try again
            </button>
            <a class="button quiet" href="#/">
              All scenes
            </a>
          </div>
        </div>
      )}
      {phase.kind === "playing" && problem && (
        <p class="floating message" data-tone="danger">
          <Icon of={CircleAlert} />
          <span>{problem}</span>
        </p>
      )}
    </div>
  );
}
