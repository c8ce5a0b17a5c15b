/** Controls of settings, with label, help and values from their table. */

import { ChevronDown } from "lucide";
import type { ComponentChildren } from "preact";
import { type Place, SETTINGS, type Settings } from "#viewer/state/settings";
import { changeSettings, settings } from "../../state/app";
import { Icon } from "../icon";
import { NumberField } from "./number-field";

type NamesOf<Kind> = {
  [Name in keyof Settings]: Settings[Name] extends Kind ? Name : never;
}[keyof Settings];
/** Names of settings with labelled values. */
type ChoiceName = {
  [Name in keyof Settings]: (typeof SETTINGS)[Name] extends { readonly options: object } ? Name : never;
}[keyof Settings];
type LabelledName = {
  [Name in keyof Settings]: (typeof SETTINGS)[Name] extends { readonly label: string } ? Name : never;
}[keyof Settings];

interface Props<Name> {
  readonly name: Name;
  readonly disabled?: boolean;
}

/** A setting that is on or off; `onChange` is called in addition. */
export function Toggle({
  name,
  disabled,
  onChange,
}: Props<NamesOf<boolean> & LabelledName> & { onChange?: (on: boolean) => void }) {
  const { label, help }: { label: string; help?: string } = SETTINGS[name];
  const checked = settings.value[name];
  return (
    <label class="check" title={help}>
      <input
        type="checkbox"
        checked={checked}
        disabled={disabled}
        onChange={() => {
          changeSettings({ [name]: !checked });
          onChange?.(!checked);
        }}
      />
      {label}
    </label>
  );
}

interface ListProps extends Props<LabelledName> {
  /** The options; by default, the table's. */
  readonly children?: ComponentChildren;
  /** Whether the label is left to assistive technology: a heading already says it. */
  readonly bare?: boolean;
  /** Of the side that it is for. */
  readonly tone?: Place;
  /** The setting's value for an option's; by default the same. */
  readonly parse?: (value: string) => Settings[LabelledName];
  /** The selected option; by default the setting's value. */
  readonly value?: string;
}

/** A setting with a list of values. */
export function Choice({ name, disabled, children, bare, tone, parse, value }: ListProps) {
  const { label, help, options }: { label: string; help?: string; options?: Readonly<Record<string, string>> } =
    SETTINGS[name];
  const list = (
    <div class="select">
      <select
        aria-label={bare ? label : undefined}
        value={value ?? String(settings.value[name])}
        disabled={disabled}
        onChange={({ currentTarget }) =>
          changeSettings({ [name]: parse ? parse(currentTarget.value) : currentTarget.value })
        }
      >
        {children ??
          Object.entries(options ?? {}).map(([option, title]) => (
            <option key={option} value={option}>
              {title}
            </option>
          ))}
      </select>
      <Icon of={ChevronDown} size={16} />
    </div>
  );
  if (bare) return list;
  return (
    // biome-ignore lint/a11y/noLabelWithoutControl: the list is its control
    <label class="number-field" title={help}>
      <span>
        {tone && <i class="swatch" data-tone={tone} />}
        {label}
      </span>
      {list}
    </label>
  );
}

/** A setting whose few values are side by side. */
export function Segments({ name }: { name: ChoiceName }) {
  const { label, options } = SETTINGS[name];
  return (
    <SegmentList name={name} label={label}>
      {Object.entries(options).map(([value, title]) => (
        <Segment
          key={value}
          name={name}
          checked={settings.value[name] === value}
          onChoose={() => changeSettings({ [name]: value })}
        >
          {title}
        </Segment>
      ))}
    </SegmentList>
  );
}

interface SegmentListProps {
  readonly name: string;
  readonly label: string;
  /** Whether the label is shown; else a heading already says it. */
  readonly headed?: boolean;
  readonly children: ComponentChildren;
}

export function SegmentList({ name, label, headed, children }: SegmentListProps) {
  return (
    <fieldset class="segments" data-choice={name}>
      <legend class={headed ? "segments-name" : "visually-hidden"}>{label}</legend>
      {children}
    </fieldset>
  );
}

export function Segment(props: { name: string; checked: boolean; onChoose: () => void; children: string }) {
  return (
    <label>
      <input type="radio" class="visually-hidden" name={props.name} checked={props.checked} onChange={props.onChoose} />
      <span>{props.children}</span>
    </label>
  );
}

/** A setting that is a number; `whole`: rounded. */
export function NumberSetting({ name, whole = false }: { name: "turnSpeed" | "lockKbps"; whole?: boolean }) {
  const { label, unit, range } = SETTINGS[name];
  const [min, max] = range;
  return (
    <NumberField
      label={label}
      unit={unit}
      min={min}
      max={max}
      value={settings.value[name]}
      onValue={(value) => changeSettings({ [name]: whole ? Math.round(value) : value })}
    />
  );
}
