/** A button with an icon; its label is its tooltip or, on request, beside the icon where there is room. */
import type { IconNode } from "lucide";
import { settings } from "../state/app";
import { Icon } from "./icon";

interface Props {
  readonly icon: IconNode;
  readonly label: string;
  readonly onClick: () => void;
  /** For a button that switches something on and off. */
  readonly pressed?: boolean;
  /** The key that does the same, as `aria-keyshortcuts` spells it. */
  readonly shortcut?: string;
  readonly worded?: boolean;
  readonly disabled?: boolean;
  readonly busy?: boolean;
}

export function IconButton({ icon, label, onClick, pressed, shortcut, worded, disabled, busy }: Props) {
  const key = settings.value.shortcuts ? shortcut : undefined;
  return (
    <button
      type="button"
      class={worded ? "icon-button worded" : "icon-button"}
      aria-label={label}
      title={key ? `${label} (${key})` : label}
      aria-pressed={pressed}
      aria-keyshortcuts={key}
      aria-busy={busy}
      disabled={disabled}
      onClick={onClick}
    >
      <Icon of={icon} />
      {worded && <span>{label}</span>}
    </button>
  );
}
