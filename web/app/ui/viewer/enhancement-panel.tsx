/** The choice of models that enhance frames before they are shown, and their status. */

import { useSignal } from "@preact/signals";
import { useCallback, useEffect } from "preact/hooks";
import type { Training } from "#client/wire/render";
import { webgpuProblem } from "#viewer/enhance/device";
import type { EnhancementStatus } from "#viewer/enhance/enhancement";
import { KINDS } from "#viewer/enhance/model/enhancer";
import type { ViewerSession } from "#viewer/session/session";
import { fetchScene, training } from "#viewer/state/api";
import { config } from "../../state/app";
import { QuietButton } from "../button";
import { milliseconds } from "../format";
import { useAttempts } from "../hooks";
import { Notice } from "../notice";
import { enhancementNote } from "./notes";
import { Choice } from "./setting";

/** Polling interval, in milliseconds. */
const ASK_EVERY = 1000;

export function SceneTraining({ session }: { session: ViewerSession }) {
  const id = session.scene.value?.id;
  return id === undefined ? null : <Networks key={id} session={session} id={id} />;
}

function Networks({ session, id }: { session: ViewerSession; id: string }) {
  const state = useSignal<Training | null>(null);
  const { problem, attempt } = useAttempts();
  const take = useCallback(
    (method?: "POST" | "DELETE") =>
      attempt(async () => {
        const before = state.peek();
        const told = await training(id, method);
        state.value = told;
        if (before?.state === "running" && told.state === "done") await renew(session, id);
      }),
    [session, id, state, attempt],
  );
  const running = state.value?.state === "running";
  useEffect(() => {
    if (!running) {
      void take();
      return;
    }
    return session.presence.every(ASK_EVERY, () => void take());
  }, [running, take, session]);
  if (state.value === null && problem.value === null) return null;
  return (
    <div class="scene-training row wrap" data-training={state.value?.state}>
      {running ? (
        <>
          <progress max={1} value={state.value?.progress} aria-label="Training" />
          <span class="muted small">{state.value?.stage}</span>
          <QuietButton onClick={() => void take("DELETE")}>Stop</QuietButton>
        </>
      ) : (
        <Offer own={session.scene.value?.enhance === "scene"} onClick={() => void take("POST")} />
      )}
      <Notice>{problem.value ?? state.value?.problem}</Notice>
    </div>
  );
}

function Offer({ own, onClick }: { own: boolean; onClick: () => void }) {
  const missing = config.value?.why_no_training;
  if (missing) return <p class="muted small">{missing}</p>;
  return (
    <QuietButton onClick={onClick}>
      {own ? "Retrain the network for this scene" : "Train a network for this scene"}
    </QuietButton>
  );
}

/** Switches to the networks that the scene has now. */
async function renew(session: ViewerSession, id: string): Promise<void> {
  const { enhance = null } = await fetchScene(id);
  const scene = session.scene.peek();
  if (scene === null) return;
  if (scene.enhance === enhance) session.source.peek()?.enhancement?.renew();
  else session.scene.value = { ...scene, enhance };
}

export function EnhancementPanel({ session }: { session: ViewerSession }) {
  const missing = webgpuProblem();
  const source = session.source.value;
  const status = source?.enhancement?.status.value ?? { kind: "off" };
  const stats = source?.stats.value;
  return (
    <>
      <div class="stack">
        {KINDS.map((kind) => (
          <Choice key={kind} name={kind} disabled={missing !== null} />
        ))}
      </div>
      {missing && (
        <p class="muted small" data-enhancement="missing">
          {missing} Frames are shown without enhancement.
        </p>
      )}
      {!missing && status.kind !== "off" && (
        <p class="muted small" role="status" data-enhancement={status.kind}>
          {sentence(status, stats?.kind === "requests" ? stats.enhanceMs : null)}
        </p>
      )}
      <SceneTraining session={session} />
    </>
  );
}

function sentence(status: EnhancementStatus, time: number | null): string {
  if (status.kind === "on") return time === null ? "On." : `On: ${milliseconds(time)} ms per frame.`;
  return enhancementNote(status) ?? "Starting…";
}
