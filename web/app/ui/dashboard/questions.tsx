/** Confirmations before a scene is renamed or deleted. */
import { useSignal } from "@preact/signals";
import type { SceneInfo } from "#client/wire/render";
import { deleteScene, renameScene } from "#viewer/state/api";
import { refreshScenes } from "../../state/app";
import { Question } from "../question";

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
      action={() => renameScene(scene.id, name.value.trim())}
      onDone={() => void refreshScenes()}
      onClose={onClose}
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
      <p class="muted small">Links with the old name stop working, and anyone viewing it has to open it again.</p>
    </Question>
  );
}

export function DeleteQuestion({ scene, onClose }: Props) {
  return (
    <Question
      title={`Delete “${scene.name}”?`}
      verb="Delete"
      action={() => deleteScene(scene.id)}
      onDone={() => void refreshScenes()}
      onClose={onClose}
    >
      <p>
        Its file, or its folder with everything in it, is deleted from the server's disk. Anyone viewing it will be
        disconnected. This cannot be undone.
      </p>
    </Question>
  );
}
