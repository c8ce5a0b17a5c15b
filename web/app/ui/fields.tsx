/** Fields of forms and panels. */
import { useSignal } from "@preact/signals";
import { ChevronDown } from "lucide";
import type { ComponentChildren, InputHTMLAttributes } from "preact";
import { Icon } from "./button";
import { clock } from "./format";

interface TextProps
  extends Pick<InputHTMLAttributes, "placeholder" | "disabled" | "required" | "maxLength" | "autofocus" | "onFocus"> {
  readonly label: string;
  readonly unit?: string;
  readonly value: string;
  readonly numeric?: boolean;
  /** Takes up a whole line. */
  readonly wide?: boolean;
  readonly invalid?: boolean;
  /** Id of the element that explains why. */
  readonly problems?: string;
  readonly onValue: (value: string) => void;
}

export function TextField({ label, unit, value, numeric, wide, invalid, problems, onValue, ...rest }: TextProps) {
  return (
    <label class="number-field small" data-wide={wide}>
      <span>
        {label} {unit && <span class="muted">{unit}</span>}
      </span>
      <input
        type="text"
        inputMode={numeric ? "decimal" : "text"}
        autocomplete="off"
        value={value}
        aria-invalid={invalid}
        aria-describedby={problems}
        onInput={(event) => onValue(event.currentTarget.value)}
        {...rest}
      />
    </label>
  );
}

interface NumberProps {
  readonly label: string;
  readonly unit: string;
  readonly value: number;
  readonly min: number;
  readonly max: number;
  readonly locked?: boolean;
  readonly onValue: (value: number) => void;
}

/** A number with its unit, applied once complete and in range; invalid input is reverted. */
export function NumberField({ label, unit, value, min, max, locked, onValue }: NumberProps) {
  /** Text being typed; kept across renders. */
  const typed = useSignal<string | null>(null);
  const rest = () => {
    typed.value = null;
  };
  const take = (number: number) => {
    rest();
    if (number >= min && number <= max) onValue(number);
  };
  return (
    <label class="number-field small" data-locked={locked || undefined}>
      <span>
        {label} <span class="muted">{unit}</span>
      </span>
      <input
        type="number"
        inputMode="decimal"
        step="any"
        min={min}
        max={max}
        value={typed.value ?? String(value)}
        onInput={(event) => {
          typed.value = event.currentTarget.value;
        }}
        onChange={(event) => take(event.currentTarget.valueAsNumber)}
        onBlur={rest}
      />
    </label>
  );
}

/** Values of a list and their titles. */
export type Options = readonly (readonly [value: string, title: string])[];

interface SelectProps {
  /** A swatch may precede the text. */
  readonly label: string;
  readonly swatch?: ComponentChildren;
  /** Whether only assistive technology gets the label, because a heading already shows it. */
  readonly bare?: boolean | undefined;
  readonly title?: string | undefined;
  readonly value: string;
  readonly options: Options;
  readonly onValue: (value: string) => void;
  readonly disabled?: boolean | undefined;
  /** Notice below the list. */
  readonly note?: string | null;
  /** An option placed before the others. */
  readonly children?: ComponentChildren;
}

export function Select({ label, swatch, bare, title, value, options, onValue, disabled, note, children }: SelectProps) {
  const list = (
    <div class="select">
      <select
        aria-label={bare ? label : undefined}
        value={value}
        disabled={disabled}
        onChange={({ currentTarget }) => onValue(currentTarget.value)}
      >
        {children}
        {options.map(([option, text]) => (
          <option key={option} value={option}>
            {text}
          </option>
        ))}
      </select>
      <Icon of={ChevronDown} size={16} />
    </div>
  );
  if (bare) return list;
  const field = (
    // biome-ignore lint/a11y/noLabelWithoutControl: the list is its control
    <label class="number-field small" title={title}>
      <span>
        {swatch}
        {label}
      </span>
      {list}
    </label>
  );
  if (!note) return field;
  return (
    <div class="number-field small">
      {field}
      <p class="muted small">{note}</p>
    </div>
  );
}

interface CheckProps {
  readonly checked: boolean;
  readonly title?: string | undefined;
  readonly disabled?: boolean | undefined;
  readonly onChange: () => void;
  readonly children: ComponentChildren;
}

export function Check({ title, children, ...input }: CheckProps) {
  return (
    <label class="check row" title={title}>
      <input type="checkbox" {...input} />
      <span>{children}</span>
    </label>
  );
}

interface RadioRow {
  readonly key: string;
  readonly title: ComponentChildren;
  readonly detail: ComponentChildren;
  readonly tooltip?: string | undefined;
  readonly disabled?: boolean;
}

interface RadioListProps {
  readonly name: string;
  readonly label: string;
  readonly rows: readonly RadioRow[];
  /** Key of the chosen row. */
  readonly chosen: string | null | undefined;
  readonly onChoose: (key: string) => void;
  readonly disabled?: boolean;
  /** Whether the list is in a scrolling box. */
  readonly boxed?: boolean;
}

export function RadioList({ name, label, rows, chosen, onChoose, disabled, boxed }: RadioListProps) {
  return (
    <fieldset class={boxed ? "rungs traces" : "rungs"} disabled={disabled}>
      <legend class="visually-hidden">{label}</legend>
      {rows.map(({ key, title, detail, tooltip, disabled }) => (
        <label key={key} title={tooltip}>
          <input type="radio" name={name} checked={key === chosen} disabled={disabled} onChange={() => onChoose(key)} />
          <span class="trace-name">{title}</span>
          <span class="muted small">{detail}</span>
        </label>
      ))}
    </fieldset>
  );
}

/** Arrow key presses from the start to the end. */
const STEPS = 200;

interface SeekProps {
  readonly label: string;
  /** Both in milliseconds. */
  readonly at: number;
  readonly duration: number;
  readonly disabled: boolean;
  readonly onSeek: (at: number) => void;
  /** Called when the handle is released. */
  readonly onRelease?: (at: number) => void;
}

/** The playback position, with a slider to change it. */
export function Seek({ label, at, duration, disabled, onSeek, onRelease }: SeekProps) {
  return (
    <div class="movement-progress small">
      <input
        type="range"
        aria-label={label}
        aria-valuetext={`${clock(at)} of ${clock(duration)}`}
        min={0}
        max={duration}
        step={duration / STEPS}
        value={at}
        disabled={disabled}
        onInput={({ currentTarget }) => onSeek(currentTarget.valueAsNumber)}
        onChange={({ currentTarget }) => onRelease?.(currentTarget.valueAsNumber)}
      />
      <output>
        {clock(at)} / {clock(duration)}
      </output>
    </div>
  );
}
