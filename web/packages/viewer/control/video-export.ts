/** A camera path as a video at full quality: the server renders each frame, one after the other. */
import type { CameraPath } from "../movement/camera-path";
import type { ViewerSession } from "../session/session";
import type { Viewport } from "../view/intrinsics";
import { camera, sizeFor } from "./screenshot";

export interface VideoOptions extends Partial<Viewport> {
  /** Frame rate, 30 by default. */
  readonly framesPerSecond?: number;
  /** Called with the share of finished frames, 0 to 1. */
  readonly onProgress?: (share: number) => void;
  /** Cancels the export; the promise rejects with its reason. */
  readonly signal?: AbortSignal;
}

/**
 * The file, as MP4 or WebM; by default in the view's size. Rejects with the reason, in one sentence for the user.
 * @internal
 */
export async function exportVideo(
  session: Pick<ViewerSession, "rig" | "scene" | "state" | "pixelRatio">,
  path: CameraPath,
  { framesPerSecond = 30, onProgress, signal = new AbortController().signal, ...wanted }: VideoOptions = {},
): Promise<Blob> {
  const { width, height } = sizeFor(session.rig.viewport.peek(), wanted, 1);
  const size = { width: even(width), height: even(height) };
  const take = camera(session, size);
  const frames = Math.floor((path.duration * framesPerSecond) / 1000) + 1;
  async function* pictures() {
    for (let frame = 0; frame < frames; frame++) {
      signal.throwIfAborted();
      yield await createImageBitmap(await take(path.at((frame * 1000) / framesPerSecond), signal));
      onProgress?.((frame + 1) / frames);
    }
  }
  const { videoFile } = await import("../export/video-file");
  return videoFile({ ...size, framesPerSecond }, pictures());
}

function even(side: number): number {
  return Math.max(2, 2 * Math.floor(side / 2));
}
