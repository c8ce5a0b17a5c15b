/** What of a link's settings makes no sense, in one sentence: it changes nothing, and nobody should take it for done. */
import { PREDICTOR_NAMES } from "../../predict/registry";
import { ASKABLE, type Asked } from "../../state/route";

/** Null if all of it does; models are told of where they would enhance. */
export function linkNote({ reprojection, prediction }: Asked, unknown: readonly string[] = []): string | null {
  if (unknown.length > 0) {
    return `The link names “${unknown.join("”, “")}”, which is nothing here; it may name ${ASKABLE.join(", ")}.`;
  }
  if (reprojection !== undefined && reprojection !== "on" && reprojection !== "off") {
    return `The link sets reprojection to “${reprojection}”: it is either on or off.`;
  }
  if (prediction !== undefined && !PREDICTOR_NAMES.some((name) => name === prediction)) {
    return `The link names a prediction that does not exist, “${prediction}”; choose one of ${PREDICTOR_NAMES.join(", ")}.`;
  }
  return null;
}
