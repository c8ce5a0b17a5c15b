/** Filters scenes by typed text. */
import type { SceneInfo } from "#client/wire/render";

/** Scenes whose name or id contains every typed word, ignoring case and accents. */
export function filterScenes(scenes: readonly SceneInfo[], text: string): SceneInfo[] {
  const words = fold(text).split(/\s+/).filter(Boolean);
  return scenes.filter(({ name, id }) => {
    const haystack = fold(`${name} ${id}`);
    return words.every((word) => haystack.includes(word));
  });
}

function fold(text: string): string {
  return text.normalize("NFD").replace(/\p{M}/gu, "").toLowerCase();
}
