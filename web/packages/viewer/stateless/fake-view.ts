/** A view for tests, at a position along x. */
import type { ViewRequest } from "./pipeline";

export function view(x: number, profile = 0): ViewRequest {
  const pose = { position: [x, 0, 0], quaternion: [0, 0, 0, 1] } as const;
  return {
    scene: "s",
    position: [...pose.position],
    quaternion: [...pose.quaternion],
    fx: 1,
    fy: 1,
    cx: 1,
    cy: 1,
    width: 2,
    height: 2,
    profile,
  };
}
