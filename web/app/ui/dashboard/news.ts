/** Result of a rescan of the models directory. */
import type { SceneInfo } from "#client/wire/render";

/** Names listed per group; the rest are counted. */
const NAMED = 3;

/** A sentence about how the list of scenes has changed. */
export function whatIsNew(before: readonly SceneInfo[], after: readonly SceneInfo[]): string {
  const old = new Map(before.map((scene) => [scene.id, scene]));
  const ids = new Set(after.map(({ id }) => id));
  const unknown = after.filter(({ id }) => !old.has(id));
  const groups = [
    group("New", unknown.filter(isSound)),
    group(
      "Changed",
      after.filter((scene) => isSound(scene) && changed(old.get(scene.id), scene)),
    ),
    group(
      "Broken",
      after.filter((scene) => !isSound(scene) && old.get(scene.id)?.error !== scene.error),
    ),
    group(
      "Removed",
      before.filter(({ id }) => !ids.has(id)),
    ),
  ].filter((words) => words !== "");
  return groups.length === 0 ? "No changes." : `${groups.join(". ")}.`;
}

function isSound({ state }: SceneInfo): boolean {
  return state !== "broken";
}

function changed(before: SceneInfo | undefined, after: SceneInfo): boolean {
  return before !== undefined && (before.file_bytes !== after.file_bytes || !isSound(before));
}

function group(word: string, scenes: readonly SceneInfo[]): string {
  if (scenes.length === 0) return "";
  const names = scenes.slice(0, NAMED).map(({ name }) => name);
  const more = scenes.length - names.length;
  return `${word}: ${names.join(", ")}${more > 0 ? ` and ${more} more` : ""}`;
}
