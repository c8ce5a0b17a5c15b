/** The files that this page adds as scenes: one after the other, wherever in the page one is meanwhile. */
import { computed, signal } from "@preact/signals";
import { refreshScenes } from "../state/app";
import { SceneUpload } from "./scene-upload";

/** Those that are under way, wait or have failed, in the order in which they were chosen. */
export const uploads = signal<readonly SceneUpload[]>([]);
export const isUploading = computed(() => uploads.value.some(({ state }) => state.value.kind !== "failed"));

let queue: Promise<unknown> = Promise.resolve();

/** `limit`: of a file, in bytes. */
export function addFiles(files: readonly File[], limit: number): void {
  for (const file of files) {
    const upload = new SceneUpload(file);
    uploads.value = [...uploads.value, upload];
    if (file.size > limit) upload.fail(`It is larger than the ${Math.floor(limit / 1e6)} MB that this server takes.`);
    else queue = queue.then(() => follow(upload));
  }
}

/** Takes one off the list; one that is under way is given up. */
export function dismiss(upload: SceneUpload): void {
  upload.cancel();
  uploads.value = uploads.value.filter((other) => other !== upload);
}

async function follow(upload: SceneUpload): Promise<void> {
  if ((await upload.run()) === null) return;
  await refreshScenes();
  dismiss(upload);
}
