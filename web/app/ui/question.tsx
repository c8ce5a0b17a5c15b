/** Dialogs that confirm an action or ask for a name; if the action fails, they stay open with the reason. */
import { useSignal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { ApiError } from "#client/http/problem";
import { Dialog } from "./dialog";

interface Props {
  readonly title: string;
  readonly verb: string;
  /** Rejects with an ApiError. */
  readonly action: () => Promise<unknown>;
  /** It has been done; the question is closed by then. */
  readonly onDone?: () => void;
  readonly onClose: () => void;
  readonly children: ComponentChildren;
}

export function Question({ title, verb, action, onDone, onClose, children }: Props) {
  const busy = useSignal(false);
  const problem = useSignal<string | null>(null);
  const act = async () => {
    busy.value = true;
    try {
      await action();
      onClose();
      onDone?.();
    } catch (error) {
      if (!(error instanceof ApiError)) throw error;
      problem.value = error.message;
    } finally {
      busy.value = false;
    }
  };
  return (
    <Dialog title={title} kind="question" onClose={onClose}>
      <form
        onSubmit={(event) => {
          event.preventDefault();
          void act();
        }}
      >
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
    </Dialog>
  );
}

interface NameProps extends Omit<Props, "action" | "children"> {
  /** The present name. */
  readonly name: string;
  readonly maxLength: number;
  /** Rejects with an ApiError. */
  readonly action: (name: string) => Promise<unknown>;
  readonly children?: ComponentChildren;
}

export function NameQuestion({ name, maxLength, action, children, ...question }: NameProps) {
  const typed = useSignal(name);
  return (
    <Question {...question} action={() => action(typed.value.trim())}>
      <label class="number-field">
        <span>New name</span>
        <input
          autofocus
          required
          maxLength={maxLength}
          value={typed.value}
          onFocus={(event) => event.currentTarget.select()}
          onInput={(event) => {
            typed.value = event.currentTarget.value;
          }}
        />
      </label>
      {children}
    </Question>
  );
}
