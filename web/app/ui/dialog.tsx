/** A modal dialog, open while mounted; unmounting restores the focus. */
import { X } from "lucide";
import type { ComponentChildren, KeyboardEventHandler } from "preact";
import { useEffect, useId, useRef } from "preact/hooks";
import { IconButton } from "./button";

interface Props {
  readonly title: string;
  /** Class name in addition to that of all dialogs. */
  readonly kind: string;
  /** Called when it is closed by its button, Escape or, if enabled, a click outside. */
  readonly onClose: () => void;
  /** Whether a click outside closes it; for dialogs without input to lose. */
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
    // The browser does this when the user closes the dialog, but not when it is unmounted.
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
      <header class="row spread">
        <h2 id={heading}>{title}</h2>
        <IconButton icon={X} label="Close" onClick={onClose} />
      </header>
      {children}
    </dialog>
  );
}
