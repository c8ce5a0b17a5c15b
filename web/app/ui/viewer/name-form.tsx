/** A form that saves something with the scene under a name. */
import { useSignal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { reason } from "./scene-edits";

/** The most characters of a name. */
export const MAX_NAME = 100;

interface NameFormProps {
  readonly label: string;
  readonly verb: string;
  readonly name: string;
  readonly onName: (name: string) => void;
  readonly disabled?: boolean;
  /** Why a name cannot be used; null if it can. */
  readonly refuse: (name: string) => string | null;
  /** The form displays the reason if it rejects. */
  readonly save: (name: string) => Promise<unknown>;
  /** Further buttons. */
  readonly children?: ComponentChildren;
}

export function NameForm({ label, verb, name, onName, disabled = false, refuse, save, children }: NameFormProps) {
  const problem = useSignal<string | null>(null);
  const busy = useSignal(false);
  const submit = async () => {
    const wanted = name.trim();
    problem.value = refuse(wanted);
    if (problem.value !== null) return;
    busy.value = true;
    try {
      await save(wanted);
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
        void submit();
      }}
    >
      <label class="number-field">
        <span>{label}</span>
        <input
          required
          maxLength={MAX_NAME}
          value={name}
          onInput={({ currentTarget }) => onName(currentTarget.value)}
        />
      </label>
      <button type="submit" class="quiet-button" disabled={busy.value || disabled}>
        {verb}
      </button>
      {children}
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
