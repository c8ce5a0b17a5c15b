/** Attributes of a tigas-viewer as settings. Pure. */
import { DEFAULT_SETTINGS, MODES, type Settings, settingOf } from "../state/settings";
import type { ScenePose } from "../view/camera";
import { poseOf } from "../view/pose-text";

/** Reads an attribute's text; null if it is missing. */
export type Attributes = (name: string) => string | null;

/** The setting of `mode`. Throws if the mode is unknown. */
export function attributeMode(of: Attributes): Pick<Settings, "mode"> {
  const name = of("mode") ?? DEFAULT_SETTINGS.mode;
  const mode = settingOf("mode", name);
  if (mode === undefined) throw new Error(`Unknown mode “${name}”: use ${MODES.join(", ")}.`);
  return { mode };
}

/** Settings of `quality`: "auto" or a rung. Throws if it is neither. */
export function attributeQuality(of: Attributes): Pick<Settings, "controller" | "profile"> {
  const { controller, profile } = DEFAULT_SETTINGS;
  const quality = of("quality") ?? "auto";
  const rung = /^\d+$/.test(quality) ? settingOf("profile", quality) : undefined;
  if (quality !== "auto" && rung === undefined) {
    throw new Error(`Unknown quality “${quality}”: use “auto”, or a number from 0 (the best).`);
  }
  return { controller: rung === undefined ? controller : "fixed", profile: rung ?? profile };
}

/** The pose of `at`; null if it is missing. Throws if it is invalid. */
export function attributePose(of: Attributes): ScenePose | null {
  const at = of("at");
  if (at === null) return null;
  const pose = poseOf(at);
  if (pose === null) throw new Error(`“${at}” is not a camera pose: use x,y,z,qx,qy,qz,qw.`);
  return pose;
}

/** URL of the picture that is shown before the first frame: the scene's thumbnail, unless `poster` names another. */
export function posterUrl(of: Attributes): string {
  const thumbnail = `scenes/${encodeURIComponent(of("scene") ?? "")}/preview`;
  return of("poster") ?? [serverUrl(of), thumbnail].filter(Boolean).join("/");
}

/** The server's URL without a trailing slash; empty for the page's own. */
export function serverUrl(of: Attributes): string {
  return (of("src") ?? "").replace(/\/+$/, "");
}
