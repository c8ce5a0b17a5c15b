/**
 * The page's address as a link to the current view, so that reloading, bookmarking or copying it preserves the view.
 */
import { effect, untracked } from "@preact/signals";
import type { ViewerSession } from "#viewer/session/session";
import { viewHash } from "./link";
import { parseRoute } from "./route";

type Visit = Pick<ViewerSession, "scene" | "rig" | "state">;

/** The camera is at rest after this many milliseconds without movement. Browsers block pages that change their address too often. */
const RESTS_AFTER = 500;

/** Sets the address to a link to the current view. */
export function showAddress(visit: Visit): void {
  const hash = linkTo(visit);
  if (hash !== null) history.replaceState(history.state, "", hash);
}

/**
 * Updates the address whenever the user's camera and settings come to rest; returns a function that stops it. The
 * address stays unchanged until the view changes, and while a script, an experiment or a movement controls it.
 */
export function keepAddress(visit: Visit): () => void {
  const { rig, scene, state } = visit;
  const { settings, settingsOverridden } = state;
  let kept: string | null = null;
  let pose = rig.pose.seq;
  let restsAt = Number.POSITIVE_INFINITY;
  const rested = () => {
    const hash = linkTo(visit);
    if (hash === kept || settingsOverridden.peek() || rig.source.peek() !== null) return;
    kept = hash;
    showAddress(visit);
  };
  const stops = [
    rig.onSample(({ seq }, at) => {
      if (seq !== pose) restsAt = at + RESTS_AFTER;
      pose = seq;
      if (at < restsAt) return;
      restsAt = Number.POSITIVE_INFINITY;
      rested();
    }),
    effect(() => {
      if (scene.value !== null) kept = untracked(() => linkTo(visit));
    }),
    effect(() => {
      settings.value;
      settingsOverridden.value;
      rig.source.value;
      pose = Number.NaN; // differs from every pose
    }),
  ];
  return () => {
    for (const stop of stops) stop();
  };
}

/** Null while the scene is not loaded, or if the address already points elsewhere. */
function linkTo({ scene, rig, state }: Visit): string | null {
  const info = scene.peek();
  const at = parseRoute(location.hash);
  if (at.page !== "viewer" || at.scene !== info?.id) return null;
  return viewHash(at.scene, rig.pose, state.settings.peek());
}
