/** The present view as a file at full quality: rendered anew by the server, in any size. */
import { sleep } from "#client/async/sleep";
import { RequestProblem } from "#client/transport/transport";
import { losslessView } from "../quality/ground-truth";
import type { ViewerSession } from "../session/session";
import type { Intrinsics, Viewport } from "../view/intrinsics";

/** A slow server draws large pictures only while no viewer has moved for two seconds, this one included. In milliseconds. */
const RETRY_AFTER = 2500;
const ATTEMPTS = 4;

/**
 * A PNG of the view; `size` is in pixels, by default the screen's. A side that is left out follows from the other. Rejects with the
 * reason, in one sentence for the user.
 */
export async function screenshot(
  { rig, scene, state, pixelRatio }: Pick<ViewerSession, "rig" | "scene" | "state" | "pixelRatio">,
  size: Partial<Viewport> = {},
  signal: AbortSignal = new AbortController().signal,
): Promise<Blob> {
  const id = scene.peek()?.id;
  if (id === undefined) throw new Error("The scene is not loaded yet.");
  const view = { ...rig.viewport.peek(), ...rig.intrinsics.peek() };
  const lens = lensFor(view, sizeFor(view, size, pixelRatio.peek()));
  const pose = rig.pose;
  for (let attempt = 1; ; attempt++) {
    try {
      return await losslessView({ server: state.config.peek(), scene: id, lens }, pose, signal);
    } catch (error) {
      if (!isOverloaded(error) || attempt === ATTEMPTS) throw error;
      await sleep(RETRY_AFTER, signal);
    }
  }
}

function isOverloaded(error: unknown): boolean {
  return error instanceof RequestProblem && error.problem.type === "tigas:overloaded";
}

function sizeFor(view: Viewport, { width, height }: Partial<Viewport>, pixelRatio: number): Viewport {
  const scale = width !== undefined ? width / view.width : height !== undefined ? height / view.height : pixelRatio;
  return { width: width ?? Math.round(view.width * scale), height: height ?? Math.round(view.height * scale) };
}

/** Shows as much from top to bottom as the view; another shape shows more or less at the sides. */
export function lensFor(view: Intrinsics & Viewport, { width, height }: Viewport): Intrinsics & Viewport {
  const scale = height / view.height;
  return {
    width,
    height,
    fx: view.fx * scale,
    fy: view.fy * scale,
    cx: width / 2 + (view.cx - view.width / 2) * scale,
    cy: view.cy * scale,
  };
}
