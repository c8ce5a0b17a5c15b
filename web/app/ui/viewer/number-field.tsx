/** A number with its unit, applied once complete and in range; invalid input is reverted. */
import { useSignal } from "@preact/signals";

interface Props {
  readonly label: string;
  readonly unit: string;
  readonly value: number;
  readonly min: number;
  readonly max: number;
  readonly locked?: boolean;
  readonly onValue: (value: number) => void;
}

export function NumberField({ label, unit, value, min, max, locked, onValue }: Props) {
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
    <label class="number-field" data-locked={locked || undefined}>
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
