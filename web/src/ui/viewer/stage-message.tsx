/** Message over the stage: loading, a lost server, or the reason for a missing picture. */
import { CircleAlert, LoaderCircle, Unplug } from "lucide";
import type { ComponentChildren } from "preact";
import type { LocalPlayer } from "../../local/local-player";
import { config } from "../../state/app";
import { isStreamed } from "../../state/settings";
import { STREAM_NAMES, type StreamKind } from "../../stream/stream";
import type { StreamPhase } from "../../stream/stream-player";
import type { ConnectionState } from "../../transport/connection";
import type { ViewerSession } from "../../viewer/session";
import type { Side } from "../../viewer/side";
import { Icon } from "../icon";
import { noPackager } from "./names";

export function StageMessage({ session }: { session: ViewerSession }) {
  const phase = session.phase.value;
  const { message, progress, kind } = { message: null, progress: undefined, ...phase };
  return (
    <div class="stage-message" role="status">
      {kind === "connecting" && <Waiting>Connecting…</Waiting>}
      {kind === "loading" && (
        <Waiting>
          Loading the scene…
          {progress !== undefined && <progress max={1} value={progress} aria-label="Loading" />}
        </Waiting>
      )}
      {kind === "full" && (
        <Waiting>The server is full. The scene opens automatically as soon as there is room.</Waiting>
      )}
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
      {kind === "playing" && (
        <div class="sides">
          <div class="side">
            <SideMessage side={session.left} session={session} />
          </div>
          {session.right.value && (
            <div class="side">
              <Connection state={session.rightConnection.value} />
              <SideMessage side={session.right.value} session={session} />
            </div>
          )}
        </div>
      )}
    </div>
  );
}

/** Reason for a missing or degraded picture. */
function SideMessage({ side, session }: { side: Side; session: ViewerSession }) {
  const { mode } = side.settings.value;
  if (isStreamed(mode)) return <Stream kind={mode} phase={side.stream.value?.phase.value} />;
  if (mode === "local") return <Local local={side.local.value} session={session} />;
  const problem = (mode === "video" && side.video.problem.value) || side.stateless.problem.value;
  return problem && <Failed>{problem}</Failed>;
}

/** For a side with its own message. */
function Connection({ state }: { state: ConnectionState | null }) {
  if (state?.status === "connecting") return <Waiting>Connecting…</Waiting>;
  if (state?.status === "full")
    return <Waiting>The server has no room for a second viewer; it is asked again.</Waiting>;
  return state?.status === "lost" ? <Lost>{state.reason}</Lost> : null;
}

function Stream({ kind, phase }: { kind: StreamKind; phase: StreamPhase | undefined }) {
  if (phase === undefined) {
    if (config.value?.services.dash) return null;
    return <Failed>{noPackager(kind)}; see Settings, Mode.</Failed>;
  }
  if (phase.kind === "connecting") return <Waiting>{`Starting the ${STREAM_NAMES[kind]} stream…`}</Waiting>;
  if (phase.kind === "lost") return <Lost>{phase.message}</Lost>;
  return phase.kind === "failed" ? <Failed>{phase.message}</Failed> : null;
}

function Local({ local, session }: { local: LocalPlayer | null; session: ViewerSession }) {
  if (local === null) {
    if (session.scene.value === null) return null;
    return <Failed>This server does not offer the scene for download; see Settings, Mode.</Failed>;
  }
  const phase = local.phase.value;
  if (phase.kind === "connecting") return <Waiting>Downloading the scene…</Waiting>;
  if (phase.kind === "lost") return <Lost>{phase.message}</Lost>;
  return phase.kind === "failed" ? <Failed>{phase.message}</Failed> : null;
}

function Waiting({ children }: { children: ComponentChildren }) {
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
