/** Dialogs that confirm an action or ask for a name; if the action fails, they stay open with the reason. */
import type { ComponentChildren } from "preact";
import { useState } from "preact/hooks";
import { Dialog } from "./dialog";
import { TextField } from "./fields";
import { useAttempts } from "./hooks";
import { Notice } from "./notice";

interface Props {
  readonly title: string;
  readonly verb: string;
  /** Rejects with the reason. */
  readonly action: () => Promise<unknown>;
  /** Called once the action is done and the dialog closed. */
  readonly onDone?: () => void;
  readonly onClose: () => void;
  readonly children: ComponentChildren;
}

export function Question({ title, verb, action, onDone, onClose, children }: Props) {
  const { busy, problem, attempt } = useAttempts();
  const act = async () => {
    if (!(await attempt(action))) return;
    onClose();
    onDone?.();
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
        <Notice>{problem.value}</Notice>
        <footer class="row wrap">
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
  readonly name: string;
  readonly maxLength: number;
  /** Rejects with the reason. */
  readonly action: (name: string) => Promise<unknown>;
  readonly children?: ComponentChildren;
}

export function NameQuestion({ name, maxLength, action, children, ...question }: NameProps) {
  const [typed, setTyped] = useState(name);
  return (
    <Question {...question} action={() => action(typed.trim())}>
      <TextField
        label="New name"
        autofocus
        required
        maxLength={maxLength}
        value={typed}
        onFocus={(event) => event.currentTarget.select()}
        onValue={setTyped}
      />
      {children}
    </Question>
  );
}
