import type { View } from "#viewer/reproject/view";
import type { ViewRequest } from "#viewer/stateless/pipeline";

/** A small camera at the origin that looks along z. */
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

/** The camera turned to the right, in degrees. */
export function turned(degrees: number): Pick<View, "quaternion"> {
  const half = (degrees * Math.PI) / 360;
  return { quaternion: [0, Math.sin(half), 0, Math.cos(half)] };
}

/** A request for the view from a position along x. */
export function view(x: number, profile = 0): ViewRequest {
  const lens = fakeView({ fx: 1, fy: 1, cx: 1, cy: 1, width: 2, height: 2 });
  return { ...lens, scene: "s", position: [x, 0, 0], quaternion: [0, 0, 0, 1], profile };
}
