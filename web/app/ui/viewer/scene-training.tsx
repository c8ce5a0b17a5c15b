/** A button that has the server train the scene's networks, or why it cannot; how far that is, and a button that stops it. */
import { useSignal } from "@preact/signals";
import { useCallback, useEffect } from "preact/hooks";
import type { Training } from "#client/wire/render";
import type { ViewerSession } from "#viewer/session/session";
import { fetchScene, training } from "#viewer/state/api";
import { config } from "../../state/app";

/** Milliseconds between two questions. */
const ASK_EVERY = 1000;

export function SceneTraining({ session }: { session: ViewerSession }) {
  const id = session.scene.value?.id;
  return id === undefined ? null : <Networks key={id} session={session} id={id} />;
}

function Networks({ session, id }: { session: ViewerSession; id: string }) {
  const state = useSignal<Training | null>(null);
  const problem = useSignal<string | null>(null);
  const take = useCallback(
    async (method?: "POST" | "DELETE") => {
      try {
        const before = state.peek();
        const told = await training(id, method);
        state.value = told;
        problem.value = told.problem ?? null;
        if (before?.state === "running" && told.state === "done") await renew(session, id);
      } catch (error) {
        problem.value = error instanceof Error ? error.message : String(error);
      }
    },
    [session, id, state, problem],
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
    <div class="scene-training" data-training={state.value?.state}>
      {running ? (
        <>
          <progress max={1} value={state.value?.progress} aria-label="Training" />
          <span class="muted small">{state.value?.stage}</span>
          <button type="button" class="quiet-button" onClick={() => void take("DELETE")}>
            Stop
          </button>
        </>
      ) : (
        <Offer own={session.scene.value?.enhance === "scene"} onClick={() => void take("POST")} />
      )}
      {problem.value !== null && (
        <p class="notice" role="alert">
          {problem.value}
        </p>
      )}
    </div>
  );
}

function Offer({ own, onClick }: { own: boolean; onClick: () => void }) {
  const missing = config.value?.why_no_training;
  if (missing) return <p class="muted small">{missing}</p>;
  return (
    <button type="button" class="quiet-button" onClick={onClick}>
      {own ? "Train the scene’s network again" : "Train the scene’s own network"}
    </button>
  );
}

/** Enhance with the networks that the scene has now. */
async function renew(session: ViewerSession, id: string): Promise<void> {
  const { enhance = null } = await fetchScene(id);
  const scene = session.scene.peek();
  if (scene === null) return;
  if (scene.enhance === enhance) session.source.peek()?.enhancement?.renew();
  else session.scene.value = { ...scene, enhance };
}
