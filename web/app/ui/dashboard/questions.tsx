/** Confirmations before a scene is renamed or deleted. */
import { useRef } from "preact/hooks";
import type { SceneInfo } from "#client/wire/render";
import { deleteScene, renameScene } from "#viewer/state/api";
import { refreshScenes } from "../../state/app";
import { NameQuestion, Question } from "../question";

interface Props {
  readonly scene: SceneInfo;
  readonly onClose: () => void;
}

export function RenameQuestion({ scene, onClose }: Props) {
  const renamed = useRef(scene.id);
  return (
    <NameQuestion
      title={`Rename “${scene.name}”`}
      verb="Rename"
      name={scene.name}
      maxLength={128}
      action={async (name) => {
        renamed.current = (await renameScene(scene.id, name)).id;
      }}
      onDone={() => void refresh(scene.id, renamed.current)}
      onClose={onClose}
    >
      <p class="muted small">Links with the old name will stop working, and viewers have to open it again.</p>
    </NameQuestion>
  );
}

export function DeleteQuestion({ scene, onClose }: Props) {
  return (
    <Question
      title={`Delete “${scene.name}”?`}
      verb="Delete"
      action={() => deleteScene(scene.id)}
      onDone={() => void refresh(scene.id)}
      onClose={onClose}
    >
      <p>
        Its file, or its folder with everything in it, will be deleted from the server's disk. Anyone viewing it will be
        disconnected. This cannot be undone.
      </p>
    </Question>
  );
}

/**
 * Refreshes the list. If the focus was on the scene's card, which then no longer exists, it moves to the card of the new
 * id, to the neighbour of the old one, or to the filter.
 */
async function refresh(id: string, now = id): Promise<void> {
  const place = cards().findIndex((card) => card.dataset.scene === id);
  await refreshScenes();
  await new Promise(requestAnimationFrame);
  if (document.activeElement !== document.body) return;
  const left = cards();
  const card = left.find(({ dataset }) => dataset.scene === now) ?? left[Math.min(place, left.length - 1)];
  const next = card?.querySelector<HTMLElement>("a, button") ?? document.querySelector<HTMLElement>("[type=search]");
  next?.focus();
}

function cards(): HTMLElement[] {
  return [...document.querySelectorAll<HTMLElement>("[data-scene]")];
}
