/** The current view as a file at full quality, rendered again by the server in any size. */
import { sleep } from "#client/async/retry";
import { RequestProblem } from "#client/transport/transport";
import { losslessView } from "../quality/ground-truth";
import type { ViewerSession } from "../session/session";
import type { ScenePose } from "../view/camera";
import type { Intrinsics, Viewport } from "../view/intrinsics";

/** A slow server draws large pictures only while no viewer has moved for two seconds, this one included. In milliseconds. */
const RETRY_AFTER = 2500;
const ATTEMPTS = 4;

type Visit = Pick<ViewerSession, "rig" | "scene" | "state" | "pixelRatio">;

/**
 * A PNG of the view; `size` is in pixels, by default the screen's. An omitted side follows from the other. Rejects with the
 * reason, in one sentence for the user.
 */
export async function screenshot(
  visit: Visit,
  size: Partial<Viewport> = {},
  signal: AbortSignal = new AbortController().signal,
): Promise<Blob> {
  const { rig, pixelRatio } = visit;
  const { pose } = rig;
  return camera(visit, sizeFor(rig.viewport.peek(), size, pixelRatio.peek()))(pose, signal);
}

/** A function that takes PNGs of any pose, with the current lens and in one size. */
export function camera(
  { rig, scene, state }: Visit,
  size: Viewport,
): (pose: ScenePose, signal: AbortSignal) => Promise<Blob> {
  const lens = lensFor({ ...rig.viewport.peek(), ...rig.intrinsics.peek() }, size);
  return async (pose, signal) => {
    const id = scene.peek()?.id;
    if (id === undefined) throw new Error("The scene is not loaded yet.");
    for (let attempt = 1; ; attempt++) {
      try {
        return await losslessView({ server: state.config.peek(), scene: id, lens }, pose, signal);
      } catch (error) {
        if (!isOverloaded(error) || attempt === ATTEMPTS) throw error;
        await sleep(RETRY_AFTER, signal);
      }
    }
  };
}

function isOverloaded(error: unknown): boolean {
  return error instanceof RequestProblem && error.problem.type === "tigas:overloaded";
}

export function sizeFor(view: Viewport, { width, height }: Partial<Viewport>, pixelRatio: number): Viewport {
  const scale = width !== undefined ? width / view.width : height !== undefined ? height / view.height : pixelRatio;
  return { width: width ?? Math.round(view.width * scale), height: height ?? Math.round(view.height * scale) };
}

/** Keeps the view's vertical field of view; another aspect ratio shows more or less at the sides. */
function lensFor(view: Intrinsics & Viewport, { width, height }: Viewport): Intrinsics & Viewport {
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
