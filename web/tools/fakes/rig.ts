/** A rig for tests: at the courtyard's start camera, and steered by the test. */
import { type Axes, NO_NUDGE } from "#viewer/view/motion";
import { Rig } from "#viewer/view/rig";
import { COURTYARD } from "./server";

export const STILL: Axes = { forward: 0, right: 0, up: 0, turnRight: 0, turnUp: 0 };

export function steeredRig(axes = () => STILL): Rig {
  const rig = new Rig({ sampleInput: () => ({ axes: axes(), nudge: NO_NUDGE }), turnSpeed: () => 60 });
  rig.enter(COURTYARD);
  return rig;
}
