/** What is asked before a scene is renamed or deleted. */
import { useSignal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { ApiError } from "../../http/problem";
import { deleteScene, renameScene } from "../../state/api";
import { refreshScenes } from "../../state/app";
import type { SceneInfo } from "../../wire/render";

interface Props {
  readonly scene: SceneInfo;
  readonly onClose: () => void;
}

export function RenameQuestion({ scene, onClose }: Props) {
  const name = useSignal(scene.name);
  return (
    <Question
      title={`Rename “${scene.name}”`}
      verb="Rename"
      onClose={onClose}
      action={() => renameScene(scene.id, name.value.trim())}
    >
      <label class="number-field">
        <span>New name</span>
        <input
          autofocus
          required
          maxLength={128}
          value={name.value}
          onFocus={(event) => event.currentTarget.select()}
          onInput={(event) => {
            name.value = event.currentTarget.value;
          }}
        />
      </label>
      <p class="muted small">Links with its old name no longer work, and whoever views it has to open it again.</p>
    </Question>
  );
}

export function DeleteQuestion({ scene, onClose }: Props) {
  return (
    <Question title={`Delete “${scene.name}”?`} verb="Delete" onClose={onClose} action={() => deleteScene(scene.id)}>
      <p>
        Its file, or its folder with everything in it, is deleted from the server's disk. Whoever views it can go no
        further. This cannot be undone.
      </p>
    </Question>
  );
}

interface QuestionProps {
  readonly title: string;
  readonly verb: string;
  readonly action: () => Promise<unknown>;
  readonly onClose: () => void;
  readonly children: ComponentChildren;
}

/** A dialog that does something if it is told to, and stays open with a sentence if that fails. */
function Question({ title, verb, action, onClose, children }: QuestionProps) {
  const dialog = useRef<HTMLDialogElement>(null);
  const busy = useSignal(false);
  const problem = useSignal<string | null>(null);
  useEffect(() => dialog.current?.showModal(), []);
  const act = async () => {
    busy.value = true;
    try {
      await action();
      await refreshScenes();
      onClose();
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      problem.value = error.message;
    } finally {
      busy.value = false;
    }
  };
  return (
    <dialog ref={dialog} class="question" aria-labelledby="question-title" onClose={onClose}>
      <form
        onSubmit={(event) => {
          event.preventDefault();
          void act();
        }}
      >
        <h2 id="question-title">{title}</h2>
        {children}
        {problem.value && (
          <p class="notice" role="alert">
            {problem.value}
          </p>
        )}
        <footer>
          <button type="button" class="button quiet" onClick={onClose}>
            Cancel
          </button>
          <button type="submit" class="button" disabled={busy.value}>
            {verb}
          </button>
        </footer>
      </form>
    </dialog>
  );
}
