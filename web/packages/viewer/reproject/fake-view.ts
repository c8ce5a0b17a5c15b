/** A small camera at the origin that looks along z, for tests. */
import type { View } from "./view";

export function fakeView(changes: Partial<View> = {}): View {
  return {
    position: [0, 0, 0],
    quaternion: [0, 0, 0, 1],
    fx: 100,
    fy: 100,
    cx: 80,
    cy: 45,
    width: 160,
    height: 90,
    ...changes,
  };
}

/** Turned to the right, in degrees. */
export function turned(degrees: number): Pick<View, "quaternion"> {
  const half = (degrees * Math.PI) / 360;
  return { quaternion: [0, Math.sin(half), 0, Math.cos(half)] };
}
