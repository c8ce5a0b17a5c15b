/** The page's address as a link to what is seen, so that who reloads, bookmarks or copies it comes back to that. */
import { effect, untracked } from "@preact/signals";
import { settings, settingsOverridden } from "../state/app";
import { viewHash } from "../state/link";
import { parseRoute } from "../state/route";
import type { ViewerSession } from "./session";

type Visit = Pick<ViewerSession, "scene" | "rig">;

/** The camera rests once it has not moved for this long, in milliseconds. Browsers refuse pages that change their address all the time. */
const RESTS_AFTER = 500;

/** The address becomes a link to what is seen now. */
export function showAddress(visit: Visit): void {
  const hash = linkTo(visit);
  if (hash !== null) history.replaceState(history.state, "", hash);
}

/**
 * The address follows the person's camera and settings, each time that they rest, until the function that this returns is called. It stays as
 * it is while a script, an experiment or a movement decides what is seen, and until something of the view has changed.
 */
export function keepAddress(visit: Visit): () => void {
  const { rig, scene } = visit;
  let kept: string | null = null;
  let timer: ReturnType<typeof setTimeout> | undefined;
  let pose = rig.pose.seq;
  const rested = () => {
    const hash = linkTo(visit);
    if (hash === kept || settingsOverridden.peek() || rig.source.peek() !== null) return;
    kept = hash;
    showAddress(visit);
  };
  const changed = () => {
    clearTimeout(timer);
    timer = setTimeout(rested, RESTS_AFTER);
  };
  const stops = [
    rig.onSample(({ seq }) => {
      if (seq !== pose) changed();
      pose = seq;
    }),
    effect(() => {
      if (scene.value !== null) kept = untracked(() => linkTo(visit));
    }),
    effect(() => {
      settings.value;
      settingsOverridden.value;
      rig.source.value;
      changed();
    }),
  ];
  return () => {
    clearTimeout(timer);
    for (const stop of stops) stop();
  };
}

/** Null where the scene is not there yet, or the address is already that of somewhere else. */
function linkTo({ scene, rig }: Visit): string | null {
  const info = scene.peek();
  const at = parseRoute(location.hash);
  if (at.page !== "viewer" || at.scene !== info?.id) return null;
  return viewHash(at.scene, rig.pose, settings.peek(), at.stamp);
}
