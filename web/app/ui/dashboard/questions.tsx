/** Confirmations before a scene is renamed or deleted. */
import type { SceneInfo } from "#client/wire/render";
import { deleteScene, renameScene } from "#viewer/state/api";
import { refreshScenes } from "../../state/app";
import { NameQuestion, Question } from "../question";

interface Props {
  readonly scene: SceneInfo;
  readonly onClose: () => void;
}

export function RenameQuestion({ scene, onClose }: Props) {
  return (
    <NameQuestion
      title={`Rename “${scene.name}”`}
      verb="Rename"
      name={scene.name}
      maxLength={128}
      action={(name) => renameScene(scene.id, name)}
      onDone={() => void refreshScenes()}
      onClose={onClose}
    >
      <p class="muted small">Links with the old name stop working, and anyone viewing it has to open it again.</p>
    </NameQuestion>
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
