/** What of a link's settings makes no sense, in one sentence: it changes nothing, and nobody should take it for done. */
import { PREDICTOR_NAMES } from "../../predict/registry";
import { linkedPose } from "../../state/link";
import { ASKABLE, type Asked } from "../../state/route";
import { LINKED, MODES, SIDE_MODES, settingOf } from "../../state/settings";

/** What shows the scene, and what is compared: the values that a link may give them. */
const CHOICES = { mode: MODES, left: SIDE_MODES, right: SIDE_MODES } as const;

/** Null if all of it does; models are told of where they would enhance. */
export function linkNote(asked: Asked, unknown: readonly string[] = []): string | null {
  const { at, reprojection, prediction, restore: _, upscale: __, ...others } = asked;
  if (unknown.length > 0) {
    return `The link names “${unknown.join("”, “")}”, which means nothing here; it may name ${ASKABLE.join(", ")}.`;
  }
  if (reprojection !== undefined && reprojection !== "on" && reprojection !== "off") {
    return `The link sets reprojection to “${reprojection}”: it is either on or off.`;
  }
  if (prediction !== undefined && !PREDICTOR_NAMES.some((name) => name === prediction)) {
    return `The link names a prediction that does not exist, “${prediction}”; choose one of ${PREDICTOR_NAMES.join(", ")}.`;
  }
  if (at !== undefined && linkedPose(asked) === null) {
    return "The link's place cannot be read: “at” takes seven numbers, x, y, z and a quaternion.";
  }
  for (const name of ["mode", "left", "right"] as const) {
    const value = asked[name];
    const values: readonly string[] = CHOICES[name];
    if (value !== undefined && !values.includes(value)) {
      return `The link sets ${name} to “${value}”, which does not exist; choose one of ${values.join(", ")}.`;
    }
  }
  const wrong = LINKED.find((name) => name in others && settingOf(name, asked[name] ?? "") === undefined);
  return wrong === undefined ? null : `The link sets ${wrong} to “${asked[wrong]}”, which it cannot be.`;
}
