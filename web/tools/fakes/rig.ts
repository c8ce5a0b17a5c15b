/** A rig for tests: at the courtyard's start camera, and steered by the test. */
import { type Axes, NO_INPUT } from "#viewer/view/motion";
import { Rig } from "#viewer/view/rig";
import { COURTYARD } from "./server";

export const STILL: Axes = NO_INPUT.axes;

export function steeredRig(axes = () => STILL): Rig {
  const rig = new Rig({ sampleInput: () => ({ ...NO_INPUT, axes: axes() }), turnSpeed: () => 60 });
  rig.enter(COURTYARD);
  return rig;
}
