/** Views that are saved with the scene: save the present one, go to one, rename and delete them. */
import { useSignal } from "@preact/signals";
import { Pencil, Trash2 } from "lucide";
import { ApiError } from "#client/http/problem";
import type { SceneInfo } from "#client/wire/render";
import type { ViewerSession } from "#viewer/session/session";
import { IconButton } from "../icon-button";
import { NameQuestion, Question } from "../question";
import { goTo, presentPose, SavedPlaces } from "./saved-places";
import { edit, mayEdit, reason } from "./scene-edits";

/** The most characters of a name. */
export const MAX_NAME = 100;

export function SavedViews({ session }: { readonly session: ViewerSession }) {
  const asked = useSignal<{ readonly what: "rename" | "delete"; readonly name: string } | null>(null);
  const scene = session.scene.value;
  if (scene === null) return null;
  const { views = {} } = scene;
  const close = () => {
    asked.value = null;
  };
  const actions = (name: string) => (
    <>
      <IconButton
        icon={Pencil}
        label={`Rename: ${name}`}
        onClick={() => {
          asked.value = { what: "rename", name };
        }}
      />
      <IconButton
        icon={Trash2}
        label={`Delete: ${name}`}
        onClick={() => {
          asked.value = { what: "delete", name };
        }}
      />
    </>
  );
  const { what, name = "" } = asked.value ?? {};
  return (
    <div class="saved-views">
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
            : "This server lets pages change no scenes."}
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
          <p>The view is deleted for everyone. This cannot be undone.</p>
        </Question>
      )}
    </div>
  );
}

function SaveView({ session, scene }: { readonly session: ViewerSession; readonly scene: SceneInfo }) {
  const typed = useSignal<string | null>(null);
  const problem = useSignal<string | null>(null);
  const busy = useSignal(false);
  const { views = {} } = scene;
  const name = typed.value ?? freeName("View", views);
  const save = async () => {
    const wanted = name.trim();
    problem.value = Object.hasOwn(views, wanted) ? taken("view", wanted) : null;
    if (problem.value !== null) return;
    busy.value = true;
    try {
      await edit(session, scene.id, { views: { [wanted]: presentPose(session) } });
      typed.value = null;
    } catch (error) {
      problem.value = reason(error);
    }
    busy.value = false;
  };
  return (
    <form
      class="save-view"
      onSubmit={(event) => {
        event.preventDefault();
        void save();
      }}
    >
      <label class="number-field">
        <span>Name</span>
        <input
          required
          maxLength={MAX_NAME}
          value={name}
          onInput={(event) => {
            typed.value = event.currentTarget.value;
          }}
        />
      </label>
      <button type="submit" class="quiet-button" disabled={busy.value}>
        Save this view
      </button>
      {problem.value !== null && (
        <p class="notice" role="alert">
          {problem.value}
        </p>
      )}
    </form>
  );
}

/** “View 1”, or the first number that is free. */
export function freeName(kind: string, names: object): string {
  let number = 1;
  while (Object.hasOwn(names, `${kind} ${number}`)) number++;
  return `${kind} ${number}`;
}

export function taken(kind: string, name: string): string {
  return `There is a ${kind} “${name}” already; choose another name.`;
}
