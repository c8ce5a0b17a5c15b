/** Links to a view: the camera pose, and the settings that affect the view. Pure. */

import type { SceneInfo } from "#client/wire/render";
import {
  COMPARED,
  choicesOf,
  DEFAULT_SETTINGS,
  LINKED,
  type LinkedName,
  type Settings,
  settingOf,
} from "#viewer/state/settings";
import type { ScenePose } from "#viewer/view/camera";
import { poseOf, poseText } from "#viewer/view/pose-text";
import { ASKABLE, type Asked, sceneHash } from "./route";

/** The hash of a link to a view, with the mode and all settings that differ from their defaults. */
export function viewHash(scene: string, pose: ScenePose, settings: Settings): string {
  const named = LINKED.filter((name) => name === "mode" || settings[name] !== DEFAULT_SETTINGS[name]);
  const chosen = named.map((name) => `&${name}=${encodeURIComponent(inText(settings[name]))}`);
  return `${sceneHash(scene)}?at=${poseText(pose)}${chosen.join("")}`;
}

/** The valid settings of a link; naming a side implies a comparison. */
export function linkedSettings(asked: Asked): Partial<Settings> {
  const found = LINKED.map((name) => [name, asked[name] === undefined ? undefined : settingOf(name, asked[name])]);
  const settings: Partial<Settings> = Object.fromEntries(found.filter(([, value]) => value !== undefined));
  const compared = settings.left !== undefined || settings.right !== undefined;
  return { ...(compared && { mode: COMPARED }), ...settings };
}

/** The pose of a link, from `at=x,y,z,qx,qy,qz,qw` or the name of a saved view; null without one. */
export function linkedPose({ at, view = "" }: Asked, views: SceneInfo["views"] = {}): ScenePose | null {
  return poseOf(at ?? "") ?? (Object.hasOwn(views, view) ? (views[view] ?? null) : null);
}

/** One sentence on invalid settings in a link, which have no effect; null if all are valid. */
export function linkNote(asked: Asked, unknown: readonly string[] = [], scene?: SceneInfo | null): string | null {
  if (unknown.length > 0) {
    return `Unknown setting in the link: “${unknown.join("”, “")}”. Supported: ${ASKABLE.join(", ")}.`;
  }
  if (asked.at !== undefined && linkedPose({ at: asked.at }) === null) {
    return "The camera pose in the link is invalid: “at” takes seven numbers, x, y, z and a quaternion.";
  }
  if (asked.view !== undefined && scene && linkedPose({ view: asked.view }, scene.views) === null) {
    return `This scene has no saved view named “${asked.view}”.`;
  }
  const wrong = LINKED.find((name) => asked[name] !== undefined && settingOf(name, asked[name]) === undefined);
  if (wrong === undefined) return null;
  const choices = choicesOf(wrong);
  const hint = choices ? `; choose one of ${choices.join(", ")}` : "";
  return `The link sets ${wrong} to “${asked[wrong]}”, which is not a valid value${hint}.`;
}

function inText(value: Settings[LinkedName]): string {
  return typeof value === "boolean" ? (value ? "on" : "off") : String(value);
}
