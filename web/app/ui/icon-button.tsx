/** A button that shows only an icon; its name is its label and its tooltip. */
import type { IconNode } from "lucide";
import { Icon } from "./icon";

interface Props {
  readonly icon: IconNode;
  readonly label: string;
  readonly onClick: () => void;
  /** For a button that switches something on and off. */
  readonly pressed?: boolean;
  /** The key that does the same, as `aria-keyshortcuts` spells it. */
  readonly shortcut?: string;
  readonly disabled?: boolean;
  readonly busy?: boolean;
}

export function IconButton({ icon, label, onClick, pressed, shortcut, disabled, busy }: Props) {
  return (
    <button
      type="button"
      class="icon-button"
      aria-label={label}
      title={shortcut ? `${label} (${shortcut})` : label}
      aria-pressed={pressed}
      aria-keyshortcuts={shortcut}
      aria-busy={busy}
      disabled={disabled}
      onClick={onClick}
    >
      <Icon of={icon} />
    </button>
  );
}
