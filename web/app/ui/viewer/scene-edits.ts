/** Edits of the scene that is being viewed, for everyone. */
import type { SceneEdit, SceneInfo } from "#client/wire/render";
import type { ViewerSession } from "#viewer/session/session";
import { editScene } from "#viewer/state/api";
import { config } from "../../state/app";

/** Whether the server lets pages change the scene; built-in ones never change. */
export function mayEdit(scene: SceneInfo): boolean {
  return (config.value?.max_upload_bytes ?? null) !== null && scene.builtin === false;
}

/** Returns the changed scene. Rejects with an ApiError. */
export async function edit(session: Pick<ViewerSession, "scene">, id: string, change: SceneEdit): Promise<SceneInfo> {
  const changed = await editScene(id, change);
  if (session.scene.peek()?.id === id) session.scene.value = changed;
  return changed;
}
