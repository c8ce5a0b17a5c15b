/** One sentence on invalid settings in a link: they have no effect, and the user should know. */
import { KINDS, OFF } from "../../enhance/model/enhancer";
import { nameProblem } from "../../enhance/registry";
import { PREDICTOR_NAMES } from "../../predict/registry";
import { linkedPose } from "../../state/link";
import { ASKABLE, type Asked } from "../../state/route";
import { LINKED, MODES, settingOf } from "../../state/settings";
import { SIDE_MODES } from "../../wire/run";

/** Values of modes and comparisons accepted in a link. */
const CHOICES = { mode: MODES, left: SIDE_MODES, right: SIDE_MODES } as const;

/** Null if all settings are valid. */
export function linkNote(asked: Asked, unknown: readonly string[] = []): string | null {
  const { at, reprojection, prediction, ...others } = asked;
  if (unknown.length > 0) {
    return `The link names “${unknown.join("”, “")}”, which means nothing here; it may name ${ASKABLE.join(", ")}.`;
  }
  if (reprojection !== undefined && reprojection !== "on" && reprojection !== "off") {
    return `The link sets reprojection to “${reprojection}”: it is either on or off.`;
  }
  for (const kind of KINDS) {
    const problem = nameProblem(kind, asked[kind] ?? OFF);
    if (problem !== null) return problem;
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
