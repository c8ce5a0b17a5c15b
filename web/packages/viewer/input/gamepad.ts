/** Gamepad input: the left stick walks, the right one turns, triggers rise and sink, bumpers change the speed. Pure. */
import type { Axes } from "../view/motion";

/** The part of a Gamepad that is used; in the standard layout. */
export interface Pad {
  readonly mapping: string;
  readonly axes: readonly number[];
  readonly buttons: readonly { readonly value: number; readonly pressed: boolean }[];
}

/** Dead zone: released sticks are not exactly centred. */
const DEAD = 0.15;
const [SLOWER, FASTER, SINK, RISE] = [4, 5, 6, 7];
const HASTE = 4;

/** Sum over all gamepads; null without input. */
export function gamepadAxes(pads: readonly (Pad | null)[]): Axes | null {
  const pad = pads.find((one) => one?.mapping === "standard" && asked(one));
  if (!pad) return null;
  const stick = (axis: number) => live(pad.axes[axis] ?? 0);
  const button = (index: number) => pad.buttons[index]?.value ?? 0;
  const haste = (pad.buttons[FASTER]?.pressed ? HASTE : 1) / (pad.buttons[SLOWER]?.pressed ? HASTE : 1);
  return {
    right: stick(0),
    forward: 0 - stick(1),
    turnRight: stick(2),
    turnUp: 0 - stick(3),
    up: button(RISE) - button(SINK),
    haste,
  };
}

function asked({ axes, buttons }: Pad): boolean {
  return axes.some((axis) => live(axis) !== 0) || buttons[SINK]?.value !== buttons[RISE]?.value;
}

/** Maps the range outside the dead zone to 0 to 1. */
function live(axis: number): number {
  return Math.sign(axis) * Math.min(1, Math.max(0, Math.abs(axis) - DEAD) / (1 - DEAD));
}
