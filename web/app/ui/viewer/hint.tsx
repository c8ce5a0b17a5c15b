/** How to move, over the picture, until the first movement. */
import { useEffect } from "preact/hooks";
import type { Rig } from "#viewer/view/rig";
import { changeSettings, settings } from "../../state/app";
import { TOUCH, useMedia } from "../hooks";

export function Hint({ rig }: { readonly rig: Rig }) {
  useEffect(() => onFirstMovement(rig, () => changeSettings({ hint: false })), [rig]);
  const touch = useMedia(TOUCH);
  const drag = settings.value.drag === "orbit" ? "Drag to orbit" : "Drag to look";
  return (
    <p class="floating hint-line">
      {touch
        ? `${drag} · pad or pinch to move · double-tap to go there`
        : `${drag} · WASD or wheel to move · double-click to go there`}
    </p>
  );
}

/** Calls back once the user moves the camera; cuts and movements that drive it do not count. */
function onFirstMovement(rig: Rig, moved: () => void): () => void {
  let { placements } = rig;
  let { seq } = rig.pose;
  return rig.onSample((pose) => {
    if (pose.seq !== seq && rig.placements === placements && rig.source.peek() === null) moved();
    placements = rig.placements;
    seq = pose.seq;
  });
}
