/** A form that saves something in the scene under a name. */
import type { ComponentChildren } from "preact";
import { ApiError } from "#client/http/problem";
import type { SceneEdit, SceneInfo } from "#client/wire/render";
import type { ViewerSession } from "#viewer/session/session";
import { editScene } from "#viewer/state/api";
import { config } from "../../state/app";
import { QuietButton } from "../button";
import { TextField } from "../fields";
import { useAttempts } from "../hooks";
import { Notice } from "../notice";

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

/** Maximum length of a name. */
export const MAX_NAME = 100;

interface NameFormProps {
  readonly label: string;
  readonly verb: string;
  readonly name: string;
  readonly onName: (name: string) => void;
  readonly disabled?: boolean;
  /** Returns why a name cannot be used; null if it can. */
  readonly refuse: (name: string) => string | null;
  /** The form displays the reason if it rejects. */
  readonly save: (name: string) => Promise<unknown>;
  readonly children?: ComponentChildren;
}

export function NameForm({ label, verb, name, onName, disabled = false, refuse, save, children }: NameFormProps) {
  const { busy, problem, attempt } = useAttempts();
  const submit = async () => {
    const wanted = name.trim();
    const refusal = refuse(wanted);
    if (refusal !== null) throw new ApiError(refusal, false);
    await save(wanted);
  };
  return (
    <form
      class="stack"
      onSubmit={(event) => {
        event.preventDefault();
        void attempt(submit);
      }}
    >
      <TextField label={label} required maxLength={MAX_NAME} value={name} onValue={onName} />
      <QuietButton type="submit" disabled={busy.value || disabled}>
        {verb}
      </QuietButton>
      {children}
      <Notice>{problem.value}</Notice>
    </form>
  );
}

/** “View 1”, or the first free number. */
export function freeName(kind: string, names: object): string {
  let number = 1;
  while (Object.hasOwn(names, `${kind} ${number}`)) number++;
  return `${kind} ${number}`;
}

export function taken(kind: string, name: string): string {
  return `A ${kind} named “${name}” already exists; choose another name.`;
}
