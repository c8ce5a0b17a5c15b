/** Views that are saved with the scene: save the current one, go to one, rename and delete them. */
import { Pencil, Trash2 } from "lucide";
import { useState } from "preact/hooks";
import { ApiError } from "#client/http/problem";
import type { SceneEdit, SceneInfo } from "#client/wire/render";
import type { ViewerSession } from "#viewer/session/session";
import { type ScenePose, viewDistance } from "#viewer/view/camera";
import { add, rotate, type Vector3 } from "#viewer/view/vector";
import { IconButton, QuietButton } from "../button";
import { useAttempts } from "../hooks";
import { Notice } from "../notice";
import { NameQuestion, Question } from "../question";
import { edit, freeName, MAX_NAME, mayEdit, NameForm, taken } from "./name-form";
import { goTo, presentPose, SavedPlaces } from "./saved-places";

/** Renders nothing if the scene cannot be changed. */
export function StartView({ session }: { readonly session: ViewerSession }) {
  const { problem, attempt } = useAttempts();
  const scene = session.scene.value;
  if (scene === null || !mayEdit(scene)) return null;
  const store = (view: SceneEdit) => attempt(async () => session.rig.enter(await edit(session, scene.id, view)));
  return (
    <div class="stack">
      <QuietButton onClick={() => void store(presentView(session, scene))}>Use this view as the start view</QuietButton>
      <QuietButton
        title="Look straight up first: the centre of the picture becomes the up direction"
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

export function SavedViews({ session }: { readonly session: ViewerSession }) {
  const [asked, setAsked] = useState<{ readonly what: "rename" | "delete"; readonly name: string }>();
  const scene = session.scene.value;
  if (scene === null) return null;
  const { views = {} } = scene;
  const close = () => setAsked(undefined);
  const actions = (name: string) => (
    <>
      <IconButton icon={Pencil} label={`Rename: ${name}`} onClick={() => setAsked({ what: "rename", name })} />
      <IconButton icon={Trash2} label={`Delete: ${name}`} onClick={() => setAsked({ what: "delete", name })} />
    </>
  );
  const { what, name = "" } = asked ?? {};
  return (
    <div class="saved-views stack">
      <SavedPlaces
        places={views}
        title="Go to this view"
        onChoose={(name) => views[name] && goTo(session, views[name])}
        {...(mayEdit(scene) && { actions })}
      />
      {mayEdit(scene) ? (
        <SaveView session={session} scene={scene} />
      ) : (
        <p class="muted small">
          {scene.builtin
            ? "This scene is part of TIGAS and cannot be changed."
            : "Scenes on this server cannot be changed from the browser."}
        </p>
      )}
      {what === "rename" && (
        <NameQuestion
          title={`Rename “${name}”`}
          verb="Rename"
          name={name}
          maxLength={MAX_NAME}
          action={async (wanted) => {
            if (wanted === name) return;
            if (Object.hasOwn(views, wanted)) throw new ApiError(taken("view", wanted), false);
            await edit(session, scene.id, { views: { [name]: null, [wanted]: views[name] ?? null } });
          }}
          onClose={close}
        />
      )}
      {what === "delete" && (
        <Question
          title={`Delete “${name}”?`}
          verb="Delete"
          action={() => edit(session, scene.id, { views: { [name]: null } })}
          onClose={close}
        >
          <p>The view will be deleted for everyone. This cannot be undone.</p>
        </Question>
      )}
    </div>
  );
}

function SaveView({ session, scene }: { readonly session: ViewerSession; readonly scene: SceneInfo }) {
  const [typed, setTyped] = useState<string | null>(null);
  const { views = {} } = scene;
  return (
    <NameForm
      label="Name"
      verb="Save this view"
      name={typed ?? freeName("View", views)}
      onName={setTyped}
      refuse={(name) => (Object.hasOwn(views, name) ? taken("view", name) : null)}
      save={async (name) => {
        await edit(session, scene.id, { views: { [name]: presentPose(session) } });
        setTyped(null);
      }}
    />
  );
}
