/** Saves a movement or a camera path as a video at full quality. */
import { signal } from "@preact/signals";
import { Film, X } from "lucide";
import { exportVideo } from "#viewer/control/video-export";
import type { CameraPath } from "#viewer/movement/camera-path";
import type { ViewerSession } from "#viewer/session/session";
import { Icon } from "../icon";
import { fileName, save } from "../save";
import { reason } from "./scene-edits";

/** The video that is being made, which continues while the settings are closed. */
const job = signal<{ readonly name: string; readonly progress: number; readonly cancel: () => void } | null>(null);
/** Which one failed last, and why; null otherwise. */
const problem = signal<{ readonly name: string; readonly why: string } | null>(null);

interface Props {
  readonly session: ViewerSession;
  /** Of the file. */
  readonly name: string;
  readonly path: () => CameraPath | null;
}

export function SaveVideo({ session, name, path }: Props) {
  const making = job.value;
  return (
    <div class="movement-video">
      {making?.name !== name ? (
        <button
          type="button"
          class="quiet-button with-icon"
          title="Every frame at full quality, rendered one after the other; this takes longer than the movement"
          disabled={making !== null}
          onClick={() => void make(session, name, path())}
        >
          <Icon of={Film} size={14} /> Save as video
        </button>
      ) : (
        <div class="movement-progress">
          <progress max={1} value={making.progress} aria-label="Saving the video" />
          <button type="button" class="quiet-button with-icon" onClick={making.cancel}>
            <Icon of={X} size={14} /> Cancel
          </button>
        </div>
      )}
      {problem.value?.name === name && (
        <p class="notice" role="alert">
          The video was not saved. {problem.value.why}
        </p>
      )}
    </div>
  );
}

async function make(session: ViewerSession, name: string, path: CameraPath | null): Promise<void> {
  if (path === null) return;
  const stop = new AbortController();
  const onProgress = (progress: number) => {
    job.value = { name, progress, cancel: () => stop.abort() };
  };
  onProgress(0);
  problem.value = null;
  try {
    const video = await exportVideo(session, path, { signal: stop.signal, onProgress });
    save(fileName(name.replace(/\.csv$/i, ""), video.type.includes("mp4") ? "mp4" : "webm"), video);
  } catch (error) {
    if (!stop.signal.aborted) problem.value = { name, why: reason(error) };
  }
  job.value = null;
}
