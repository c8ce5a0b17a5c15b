/** A modal dialogue, open for as long as it is there; the focus is where it was before once it is gone. */
import { X } from "lucide";
import type { ComponentChildren, KeyboardEventHandler } from "preact";
import { useEffect, useId, useRef } from "preact/hooks";
import { IconButton } from "./icon-button";

interface Props {
  readonly title: string;
  /** Its class, beside that of all dialogues. */
  readonly kind: string;
  /** Its button or Escape closed it, or a click beside it where that does. */
  readonly onClose: () => void;
  /** Nothing is lost by it: a click beside it closes it. */
  readonly light?: boolean;
  readonly onKeyDown?: KeyboardEventHandler<HTMLDialogElement>;
  readonly children: ComponentChildren;
}

export function Dialog({ title, kind, onClose, light, onKeyDown, children }: Props) {
  const dialog = useRef<HTMLDialogElement>(null);
  const heading = useId();
  useEffect(() => {
    const before = document.activeElement;
    dialog.current?.showModal();
    // The browser does so where it closed the dialogue itself, not where that is only taken away.
    return () => before instanceof HTMLElement && before.focus({ preventScroll: true });
  }, []);
  return (
    <dialog
      ref={dialog}
      class={`dialog ${kind}`}
      aria-labelledby={heading}
      onClose={onClose}
      onClick={(event) => light && event.target === event.currentTarget && onClose()}
      onKeyDown={onKeyDown}
    >
      <header>
        <h2 id={heading}>{title}</h2>
        <IconButton icon={X} label="Close" onClick={onClose} />
      </header>
      {children}
    </dialog>
  );
}
