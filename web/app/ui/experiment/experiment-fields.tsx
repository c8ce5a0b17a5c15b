/** The fields of the experiment's form. */
import { ChevronDown } from "lucide";
import type { ComponentChildren } from "preact";
import { Icon } from "../icon";

interface TextProps {
  readonly label: string;
  readonly unit?: string;
  readonly value: string;
  readonly numeric?: boolean;
  /** It takes a whole line. */
  readonly wide?: boolean;
  readonly placeholder?: string;
  readonly disabled?: boolean;
  readonly onValue: (value: string) => void;
}

export function TextField({ label, unit, value, numeric, wide, placeholder, disabled, onValue }: TextProps) {
  return (
    <label class="number-field" data-wide={wide}>
      <span>
        {label} {unit && <span class="muted">{unit}</span>}
      </span>
      <input
        type="text"
        inputMode={numeric ? "decimal" : "text"}
        autocomplete="off"
        placeholder={placeholder}
        disabled={disabled}
        value={value}
        onInput={(event) => onValue(event.currentTarget.value)}
      />
    </label>
  );
}

interface SelectProps {
  readonly label: string;
  readonly value: string;
  readonly onValue: (value: string) => void;
  readonly disabled?: boolean;
  /** Notices about it. */
  readonly note?: string | undefined;
  readonly children: ComponentChildren;
}

export function Select({ label, value, disabled, onValue, note, children }: SelectProps) {
  return (
    <div class="number-field">
      <label>
        {label}
        <div class="select">
          <select value={value} disabled={disabled} onChange={(event) => onValue(event.currentTarget.value)}>
            {children}
          </select>
          <Icon of={ChevronDown} size={16} />
        </div>
      </label>
      {note && <p class="muted small">{note}</p>}
    </div>
  );
}
