/** Controls for settings, with label, help and values from their table. */
import { type Place, SETTINGS, type Settings } from "#viewer/state/settings";
import { changeSettings, settings } from "../../state/app";
import { Check, NumberField, type Options, Select } from "../fields";

type NamesOf<Kind> = {
  [Name in keyof Settings]: Settings[Name] extends Kind ? Name : never;
}[keyof Settings];
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
  const change = () => {
    changeSettings({ [name]: !checked });
    onChange?.(!checked);
  };
  return (
    <Check title={help} checked={checked} disabled={disabled} onChange={change}>
      {label}
    </Check>
  );
}

interface ListProps extends Props<LabelledName> {
  /** Options to choose from; by default the table's. */
  readonly options?: Options;
  /** Whether only assistive technology gets the label, because a heading already shows it. */
  readonly bare?: boolean;
  /** Colour of the side that the setting is for. */
  readonly tone?: Place;
  /** Converts an option's value to the setting's; by default they are the same. */
  readonly parse?: (value: string) => Settings[LabelledName];
  /** The selected option; by default the setting's value. */
  readonly value?: string;
}

export function Choice({ name, disabled, options, bare, tone, parse, value }: ListProps) {
  const about: { label: string; help?: string; options?: Readonly<Record<string, string>> } = SETTINGS[name];
  return (
    <Select
      label={about.label}
      swatch={tone && <i class="swatch" data-tone={tone} />}
      bare={bare}
      title={about.help}
      value={value ?? String(settings.value[name])}
      options={options ?? Object.entries(about.options ?? {})}
      disabled={disabled}
      onValue={(chosen) => changeSettings({ [name]: parse ? parse(chosen) : chosen })}
    />
  );
}

/** A setting with a few values, side by side. */
export function Segments({ name, headed }: { readonly name: ChoiceName; readonly headed?: boolean }) {
  const { label, options } = SETTINGS[name];
  const choices = Object.entries(options).map(([value, title]) => ({
    title,
    chosen: settings.value[name] === value,
    part: { [name]: value },
  }));
  return <SegmentList name={name} label={label} headed={headed} choices={choices} />;
}

interface SegmentListProps {
  readonly name: string;
  readonly label: string;
  /** Whether to show the label; if not, a heading already does. */
  readonly headed?: boolean | undefined;
  readonly choices: readonly {
    readonly title: string;
    readonly chosen: boolean;
    readonly part: Partial<Settings>;
  }[];
}

/** Choices side by side that change settings. */
export function SegmentList({ name, label, headed, choices }: SegmentListProps) {
  return (
    <fieldset class="segments row wrap" data-choice={name}>
      <legend class={headed ? "segments-name small" : "visually-hidden"}>{label}</legend>
      {choices.map(({ title, chosen, part }) => (
        <label key={title} class="small">
          <input
            type="radio"
            class="visually-hidden"
            name={name}
            checked={chosen}
            onChange={() => changeSettings(part)}
          />
          <span>{title}</span>
        </label>
      ))}
    </fieldset>
  );
}

/** A numeric setting, rounded if `whole`. */
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
