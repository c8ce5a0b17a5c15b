/** What the stage has to say: what is awaited, that a server is away, or why there is no picture. */
import { CircleAlert, LoaderCircle, Unplug } from "lucide";
import type { ComponentChildren } from "preact";
import type { DashPhase } from "../../dash/dash-player";
import { config, settings } from "../../state/app";
import { isPerView, isStreamed, type Mode } from "../../state/settings";
import type { ViewerSession } from "../../viewer/session";
import { Icon } from "../icon";

export function StageMessage({ session }: { session: ViewerSession }) {
  const phase = session.phase.value;
  const { mode } = settings.value;
  const problem = isPerView(mode) ? problemOf(session, mode) : null;
  const { message, kind } = { message: null, ...phase };
  return (
    <div class="stage-message" role="status">
      {(kind === "connecting" || kind === "loading") && (
        <Waiting>{kind === "loading" ? "Loading the scene…" : "Connecting…"}</Waiting>
      )}
      {kind === "full" && <Waiting>The server is full. The scene opens by itself as soon as there is room.</Waiting>}
      {kind === "lost" && <Lost>{message}</Lost>}
      {kind === "failed" && (
        <div class="floating message tall" data-tone="danger">
          <Icon of={CircleAlert} />
          <p>{message}</p>
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
      {kind === "playing" && problem && <Failed>{problem}</Failed>}
      {kind === "playing" && mode === "local" && <Local session={session} />}
      {kind === "playing" && isStreamed(mode) && (
        <div class="dash-message">
          <Dash phase={session.dash.value?.phase.value} />
        </div>
      )}
    </div>
  );
}

/** Why no frames come, in the modes that ask for each by itself. */
function problemOf({ stateless, video }: ViewerSession, mode: Mode): string | null {
  return (mode === "video" && video.problem.value) || stateless.problem.value;
}

function Dash({ phase }: { phase: DashPhase | undefined }) {
  if (phase === undefined) {
    if (config.value?.services.dash) return null;
    return <Failed>This server has no DASH packager; see Settings, Mode.</Failed>;
  }
  if (phase.kind === "connecting") return <Waiting>Starting the stream…</Waiting>;
  if (phase.kind === "lost") return <Lost>{phase.message}</Lost>;
  return phase.kind === "failed" ? <Failed>{phase.message}</Failed> : null;
}

function Local({ session }: { session: ViewerSession }) {
  const local = session.local.value;
  if (local === null) {
    if (session.scene.value === null) return null;
    return <Failed>This server does not offer the scene for download; see Settings, Mode.</Failed>;
  }
  const phase = local.phase.value;
  if (phase.kind === "connecting") return <Waiting>Downloading the scene…</Waiting>;
  if (phase.kind === "lost") return <Lost>{phase.message}</Lost>;
  return phase.kind === "failed" ? <Failed>{phase.message}</Failed> : null;
}

function Waiting({ children }: { children: string }) {
  return (
    <p class="floating message">
      <span class="spinner">
        <Icon of={LoaderCircle} />
      </span>
      {children}
    </p>
  );
}

function Lost({ children }: { children: ComponentChildren }) {
  return (
    <p class="floating message" data-tone="warning">
      <Icon of={Unplug} />
      <span>{children} Trying again…</span>
    </p>
  );
}

function Failed({ children }: { children: ComponentChildren }) {
  return (
    <p class="floating message" data-tone="danger">
      <Icon of={CircleAlert} />
      <span>{children}</span>
    </p>
  );
}
