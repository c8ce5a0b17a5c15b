/** Buttons with Lucide's icons. */
import { FolderOpen, type IconNode } from "lucide";
import { type ButtonHTMLAttributes, type ComponentChildren, h } from "preact";
import { useRef } from "preact/hooks";
import { settings } from "../state/app";

/** In the text colour; hidden from screen readers, which read the button's label. */
export function Icon({ of, size = 18 }: { of: IconNode; size?: number }) {
  return (
    <svg
      aria-hidden="true"
      class="icon"
      width={size}
      height={size}
      viewBox="0 0 24 24"
      fill="none"
      stroke="currentColor"
      stroke-width="1.75"
      stroke-linecap="round"
      stroke-linejoin="round"
    >
      {of.map(([tag, attributes]) => h(tag, attributes))}
    </svg>
  );
}

interface IconButtonProps extends Pick<ButtonHTMLAttributes, "disabled" | "aria-expanded" | "aria-controls"> {
  readonly icon: IconNode;
  readonly label: string;
  /** The tooltip, if it is not the label. */
  readonly title?: string;
  readonly onClick: () => void;
  /** State of a toggle button. */
  readonly pressed?: boolean;
  /** The equivalent key, as spelled in `aria-keyshortcuts`. */
  readonly shortcut?: string;
  /** Shows the label next to the icon. */
  readonly worded?: boolean;
  readonly busy?: boolean;
}

export function IconButton({ icon, label, title = label, pressed, shortcut, worded, busy, ...rest }: IconButtonProps) {
  const key = settings.value.shortcuts ? shortcut : undefined;
  return (
    <button
      type="button"
      class={worded ? "icon-button worded" : "icon-button"}
      aria-label={label}
      title={key ? `${title} (${key})` : title}
      aria-pressed={pressed}
      aria-keyshortcuts={key}
      aria-busy={busy}
      {...rest}
    >
      <Icon of={icon} />
      {worded && <span>{label}</span>}
    </button>
  );
}

interface QuietButtonProps extends Pick<ButtonHTMLAttributes, "disabled" | "title" | "type" | "aria-label"> {
  readonly icon?: IconNode;
  /** An additional class. */
  readonly kind?: string;
  readonly onClick?: () => void;
  readonly children: ComponentChildren;
}

export function QuietButton({ icon, kind, children, ...rest }: QuietButtonProps) {
  return (
    <button type="button" class={kind ? `quiet-button ${kind}` : "quiet-button"} {...rest}>
      {icon && <Icon of={icon} size={14} />} {children}
    </button>
  );
}

interface FileButtonProps extends Pick<ButtonHTMLAttributes, "disabled" | "title"> {
  /** Label of the input, for assistive technology. */
  readonly label: string;
  readonly accept?: string;
  readonly onFile: (file: File) => void;
  readonly children: ComponentChildren;
}

/** Opens a local file. */
export function FileButton({ label, accept, onFile, ...rest }: FileButtonProps) {
  const input = useRef<HTMLInputElement>(null);
  return (
    <>
      <QuietButton icon={FolderOpen} onClick={() => input.current?.click()} {...rest} />
      <input
        ref={input}
        type="file"
        hidden
        aria-label={label}
        accept={accept}
        onChange={({ currentTarget }) => {
          const [file] = currentTarget.files ?? [];
          if (file) onFile(file);
          currentTarget.value = ""; // so that the same file can be chosen again
        }}
      />
    </>
  );
}
