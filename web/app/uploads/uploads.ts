/** Files uploaded as scenes, one after the other, even while another part of the page is open. */
import { computed, signal } from "@preact/signals";
import { refreshScenes } from "../state/app";
import { SceneUpload } from "./scene-upload";

/** Active, waiting and failed uploads, in order of selection. */
export const uploads = signal<readonly SceneUpload[]>([]);
export const isUploading = computed(() => uploads.value.some(({ state }) => state.value.kind !== "failed"));

/** Ids of scenes that were added and not opened since. */
export const added = signal<ReadonlySet<string>>(new Set());

let queue: Promise<unknown> = Promise.resolve();

/** `limit` is the largest file size, in bytes. */
export function addFiles(files: readonly File[], limit: number): void {
  for (const file of files) {
    const upload = new SceneUpload(file);
    uploads.value = [...uploads.value, upload];
    if (file.size > limit)
      upload.refuse(`The file is larger than ${Math.floor(limit / 1e6)} MB, the limit of this server.`);
    else enqueue(upload);
  }
}

/** Tries a failed upload again, after the others; the server may have kept its file. */
export function tryAgain(upload: SceneUpload): void {
  upload.wait();
  enqueue(upload);
}

/** Removes an upload from the list and cancels it if it is active. */
export function dismiss(upload: SceneUpload): void {
  upload.cancel();
  uploads.value = uploads.value.filter((other) => other !== upload);
}

function enqueue(upload: SceneUpload): void {
  queue = queue.then(() => follow(upload));
}

async function follow(upload: SceneUpload): Promise<void> {
  const scene = await upload.run();
  if (scene === null) return;
  added.value = new Set([...added.value, scene.id]);
  await refreshScenes();
  dismiss(upload);
}
