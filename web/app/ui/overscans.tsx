/** How much more frames show at each side, for a list to choose from. */
import type { Settings } from "#viewer/state/settings";

type Overscan = Settings["overscan"];

const SHARES = [0, 0.05, 0.1, 0.15, 0.2, 0.25];

/** Options of the list, including the present value. */
export function OverscanOptions({ chosen }: { readonly chosen: Overscan }) {
  const shares = chosen === "auto" || SHARES.includes(chosen) ? SHARES : [...SHARES, chosen];
  return (
    <>
      <option value="auto">Automatic</option>
      {shares.map((share) => (
        <option key={share} value={String(share)}>
          {Math.round(share * 1000) / 10} %
        </option>
      ))}
    </>
  );
}

/** The selected option. */
export function overscanOf(value: string): Overscan {
  return value === "auto" ? "auto" : Number(value);
}
