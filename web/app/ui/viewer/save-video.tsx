/** Saves a movement or a camera path as a video at full quality. */
import { signal } from "@preact/signals";
import { Film, X } from "lucide";
import { exportVideo } from "#viewer/control/video-export";
import type { CameraPath } from "#viewer/movement/camera-path";
import type { ViewerSession } from "#viewer/session/session";
import { exporting } from "../../state/app";
import { QuietButton } from "../button";
import { reason } from "../hooks";
import { Notice } from "../notice";
import { fileName, save } from "../save";

/** The video that is being made, which continues while the lab is closed. */
const job = signal<{ readonly of: Kind; readonly progress: number; readonly cancel: () => void } | null>(null);
/** Why the last one failed; null otherwise. */
const problem = signal<{ readonly of: Kind; readonly why: string } | null>(null);

type Kind = "movement" | "path";

interface Props {
  readonly session: ViewerSession;
  readonly of: Kind;
  readonly name: string;
  readonly path: () => CameraPath | null;
}

export function SaveVideo({ session, of, name, path }: Props) {
  const making = job.value;
  return (
    <div class="stack">
      {making?.of !== of ? (
        <QuietButton
          icon={Film}
          title="Renders every frame at full quality, which takes longer than playing the movement"
          disabled={making !== null}
          onClick={() => void make({ session, of, name, path })}
        >
          Save as video
        </QuietButton>
      ) : (
        <div class="movement-progress">
          <progress max={1} value={making.progress} aria-label="Saving the video" />
          <QuietButton icon={X} onClick={making.cancel}>
            Cancel
          </QuietButton>
        </div>
      )}
      {problem.value?.of === of && <Notice>The video could not be saved. {problem.value.why}</Notice>}
    </div>
  );
}

async function make({ session, of, name, path }: Props): Promise<void> {
  const way = path();
  if (way === null) return;
  const stop = new AbortController();
  const onProgress = (progress: number) => {
    job.value = { of, progress, cancel: () => stop.abort() };
  };
  onProgress(0);
  exporting.value = true;
  problem.value = null;
  try {
    const video = await exportVideo(session, way, { signal: stop.signal, onProgress });
    save(fileName(name.replace(/\.csv$/i, ""), video.type.includes("mp4") ? "mp4" : "webm"), video);
  } catch (error) {
    if (!stop.signal.aborted) problem.value = { of, why: reason(error) };
  }
  job.value = null;
  exporting.value = false;
}
