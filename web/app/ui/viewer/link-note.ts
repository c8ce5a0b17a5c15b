/** One sentence on invalid settings in a link: they have no effect, and the user should know. */

import type { SceneInfo } from "#client/wire/render";
import { choicesOf, LINKED, settingOf } from "#viewer/state/settings";
import { linkedPose } from "../../state/link";
import { ASKABLE, type Asked } from "../../state/route";

/** Null if all settings are valid. */
export function linkNote(asked: Asked, unknown: readonly string[] = [], scene?: SceneInfo | null): string | null {
  if (unknown.length > 0) {
    return `The link names “${unknown.join("”, “")}”, which means nothing here; it may name ${ASKABLE.join(", ")}.`;
  }
  if (asked.at !== undefined && linkedPose({ at: asked.at }) === null) {
    return "The link's place cannot be read: “at” takes seven numbers, x, y, z and a quaternion.";
  }
  if (asked.view !== undefined && scene && linkedPose({ view: asked.view }, scene.views) === null) {
    return `This scene has no saved view “${asked.view}”.`;
  }
  const wrong = LINKED.find((name) => asked[name] !== undefined && settingOf(name, asked[name]) === undefined);
  if (wrong === undefined) return null;
  const choices = choicesOf(wrong);
  const hint = choices ? `; choose one of ${choices.join(", ")}` : "";
  return `The link sets ${wrong} to “${asked[wrong]}”, which it cannot be${hint}.`;
}
