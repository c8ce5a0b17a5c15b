/** Messages over the stage: loading, a lost server, the reason for a missing picture, or a frozen one. */

import { CircleAlert, LoaderCircle, Snowflake, Unplug } from "lucide";
import type { ComponentChildren } from "preact";
import type { ConnectionState } from "#client/transport/connection";
import type { ViewerSession } from "#viewer/session/session";
import type { Side } from "#viewer/session/side";
import { sideTitles } from "#viewer/sources/sides";
import { FROZEN_AFTER } from "#viewer/view/meter";
import { settings } from "../../state/app";
import { Icon } from "../button";

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
        <Waiting>The server is full. The scene will open automatically as soon as there is room.</Waiting>
      )}
      {kind === "lost" && <Lost>{session.presence.offline.value ? "This device is offline." : message}</Lost>}
      {kind === "failed" && (
        <div class="floating message row tall" data-tone="danger">
          <Icon of={CircleAlert} />
          <p>{message}</p>
          <div class="row">
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
            <SideMessage side={session.left} />
          </div>
          {session.right.value && (
            <div class="side">
              <Connection state={session.rightConnection.value} />
              <SideMessage side={session.right.value} />
            </div>
          )}
        </div>
      )}
    </div>
  );
}

/** Reason for a missing or degraded picture. */
function SideMessage({ side }: { side: Side }) {
  const missing = side.missing.value;
  if (missing !== null) return <Failed>{missing}. Choose another mode in the lab, or Stream under View.</Failed>;
  const phase = side.source.value?.phase.value ?? { kind: "connecting", message: "Starting…" };
  switch (phase.kind) {
    case "connecting":
      return <Waiting>{phase.message ?? "Connecting…"}</Waiting>;
    case "lost":
      return <Lost>{phase.message}</Lost>;
    case "failed":
      return <Failed>{phase.message}</Failed>;
    default:
      return phase.problem ? <Failed>{phase.problem}</Failed> : null;
  }
}

/** State of a side's own connection. */
function Connection({ state }: { state: ConnectionState | null }) {
  if (state?.status === "connecting") return <Waiting>Connecting…</Waiting>;
  if (state?.status === "full") return <Waiting>The server has no room for a second viewer. Trying again…</Waiting>;
  return state?.status === "lost" ? <Lost>{state.reason}</Lost> : null;
}

function Waiting({ children }: { children: ComponentChildren }) {
  return (
    <p class="floating message row">
      <span class="spinner">
        <Icon of={LoaderCircle} />
      </span>
      {children}
    </p>
  );
}

function Lost({ children }: { children: ComponentChildren }) {
  return (
    <p class="floating message row" data-tone="warning">
      <Icon of={Unplug} />
      <span>{children} Trying again…</span>
    </p>
  );
}

function Failed({ children }: { children: ComponentChildren }) {
  return (
    <p class="floating message row" data-tone="danger">
      <Icon of={CircleAlert} />
      <span>{children}</span>
    </p>
  );
}

/** Reports for how long a picture has been frozen although the camera moved. */
export function Freeze({ session }: { session: ViewerSession }) {
  const names = sideTitles(settings.value);
  const frozen = [session.left, session.right.value].flatMap((side, i) => {
    const time = side?.figures?.frozenFor ?? 0;
    return time < FROZEN_AFTER ? [] : [{ name: names.length > 1 ? `${names[i]}: frozen` : "Frozen", time }];
  });
  if (session.phase.value.kind !== "playing" || frozen.length === 0) return null;
  return (
    <p class="floating freeze row small" data-stat="frozen">
      <Icon of={Snowflake} size={16} />
      {frozen.map(({ name, time }) => (
        <span key={name}>
          {name}, no new picture for {(time / 1000).toFixed(1)} s
        </span>
      ))}
    </p>
  );
}
