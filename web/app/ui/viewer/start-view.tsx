/** Buttons that store the present view as the scene's start view, for everyone. */
import type { SceneEdit, SceneInfo } from "#client/wire/render";
import type { ViewerSession } from "#viewer/session/session";
import { type ScenePose, viewDistance } from "#viewer/view/camera";
import { add, rotate, type Vector3 } from "#viewer/view/vector";
import { QuietButton } from "../button";
import { useAttempts } from "../hooks";
import { Notice } from "../notice";
import { edit, mayEdit } from "./scene-edits";

/** Nothing where the scene cannot be changed. */
export function StartView({ session }: { readonly session: ViewerSession }) {
  const { problem, attempt } = useAttempts();
  const scene = session.scene.value;
  if (scene === null || !mayEdit(scene)) return null;
  const store = (view: SceneEdit) => attempt(async () => session.rig.enter(await edit(session, scene.id, view)));
  return (
    <div class="stack">
      <QuietButton onClick={() => void store(presentView(session, scene))}>Use this view as the start view</QuietButton>
      <QuietButton
        title="Look at the sky first: the middle of the picture becomes up"
        onClick={() => void store(uprightView(session, scene))}
      >
        This way is up
      </QuietButton>
      <Notice>{problem.value}</Notice>
    </div>
  );
}

function presentView({ rig }: ViewerSession, scene: SceneInfo): SceneEdit {
  const [position, look_at] = segment(rig.pose, [0, 0, viewDistance(scene)]);
  return { camera: { position, look_at }, up: scene.up };
}

/** The viewing direction becomes up, and the bottom of the picture the direction of the new start view. */
function uprightView({ rig }: ViewerSession, scene: SceneInfo): SceneEdit {
  const [position, look_at] = segment(rig.pose, [0, viewDistance(scene), 0]);
  const [x, y, z] = rotate(rig.pose.quaternion, [0, 0, 1]);
  return { camera: { position, look_at }, up: [x, y, z] };
}

type Point = [number, number, number];

/** The camera's position, and the end of an offset from it in its own axes. */
function segment({ position, quaternion }: ScenePose, offset: Vector3): [Point, Point] {
  return [[...position], [...add(position, rotate(quaternion, offset))]];
}
