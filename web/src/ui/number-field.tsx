/** A number with its unit, taken over when it is complete and in range; anything else is put back. */

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
  const take = (input: HTMLInputElement) => {
    const number = input.valueAsNumber;
    if (number >= min && number <= max) onValue(number);
    else input.value = String(value);
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
        value={value}
        onChange={(event) => take(event.currentTarget)}
      />
    </label>
  );
}
