/** Saves the chosen movement as a video at full quality. */
import { signal } from "@preact/signals";
import { Film, X } from "lucide";
import { exportVideo } from "#viewer/control/video-export";
import type { ViewerSession } from "#viewer/session/session";
import { Icon } from "../icon";
import { fileName, save } from "../save";

/** The video that is being made, which continues while the settings are closed. */
const job = signal<{ readonly progress: number; readonly cancel: () => void } | null>(null);
/** Why the last one failed; null otherwise. */
const problem = signal<string | null>(null);

export function SaveVideo({ session }: { session: ViewerSession }) {
  const making = job.value;
  if (session.movement.movement.value === null || session.scene.value === null) return null;
  return (
    <div class="movement-video">
      {making === null ? (
        <button
          type="button"
          class="quiet-button with-icon"
          title="Every frame at full quality, rendered one after the other; this takes longer than the movement"
          onClick={() => void make(session)}
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
      {problem.value && (
        <p class="notice" role="alert">
          The video was not saved. {problem.value}
        </p>
      )}
    </div>
  );
}

async function make(session: ViewerSession): Promise<void> {
  const { path, movement } = session.movement;
  const name = movement.peek()?.name.replace(/\.csv$/i, "") ?? "video";
  if (path === null) return;
  const stop = new AbortController();
  const onProgress = (progress: number) => {
    job.value = { progress, cancel: () => stop.abort() };
  };
  onProgress(0);
  problem.value = null;
  try {
    const video = await exportVideo(session, path, { signal: stop.signal, onProgress });
    save(fileName(name, video.type.includes("mp4") ? "mp4" : "webm"), video);
  } catch (error) {
    if (!stop.signal.aborted) problem.value = error instanceof Error ? error.message : String(error);
  }
  job.value = null;
}
