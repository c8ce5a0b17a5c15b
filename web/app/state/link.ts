/** Links to a view: the camera pose, and the settings that affect the view. Pure. */

import { COMPARED, DEFAULT_SETTINGS, LINKED, type LinkedName, type Settings, settingOf } from "#viewer/state/settings";
import type { ScenePose } from "#viewer/view/camera";
import { type Asked, sceneHash } from "./route";

/** Digits of a place and of a rotation, so that a link stays short. */
const PLACE_DIGITS = 6;
const ROTATION_DIGITS = 5;

/** The hash of a link to a view: settings that are not the usual ones, and the mode in any case. */
export function viewHash(scene: string, { position, quaternion }: ScenePose, settings: Settings): string {
  const rounded = (digits: number) => (value: number) => String(Number(value.toPrecision(digits)));
  const at = [...position.map(rounded(PLACE_DIGITS)), ...quaternion.map(rounded(ROTATION_DIGITS))].join();
  const named = LINKED.filter((name) => name === "mode" || settings[name] !== DEFAULT_SETTINGS[name]);
  const chosen = named.map((name) => `&${name}=${encodeURIComponent(inText(settings[name]))}`);
  return `${sceneHash(scene)}?at=${at}${chosen.join("")}`;
}

/** The valid settings of a link; naming a side implies a comparison. */
export function linkedSettings(asked: Asked): Partial<Settings> {
  const found = LINKED.map((name) => [name, asked[name] === undefined ? undefined : settingOf(name, asked[name])]);
  const settings: Partial<Settings> = Object.fromEntries(found.filter(([, value]) => value !== undefined));
  const compared = settings.left !== undefined || settings.right !== undefined;
  return { ...(compared && { mode: COMPARED }), ...settings };
}

/** The pose of a link, from `at=x,y,z,qx,qy,qz,qw`; null without one. */
export function linkedPose({ at }: Asked): ScenePose | null {
  const [x, y, z, qx, qy, qz, qw, ...more] = (at ?? "")
    .split(",")
    .map((text) => (text.trim() ? Number(text) : Number.NaN));
  if (x === undefined || y === undefined || z === undefined || qw === undefined || more.length > 0) return null;
  if (qx === undefined || qy === undefined || qz === undefined) return null;
  const length = Math.hypot(qx, qy, qz, qw);
  if (!Number.isFinite(x + y + z) || !(length > 0.1 && length < 10)) return null;
  return { position: [x, y, z], quaternion: [qx / length, qy / length, qz / length, qw / length] };
}

function inText(value: Settings[LinkedName]): string {
  return typeof value === "boolean" ? (value ? "on" : "off") : String(value);
}
