/** A confirmation dialog; if the action fails, it stays open with the reason. */
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
