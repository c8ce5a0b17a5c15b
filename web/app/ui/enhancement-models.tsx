/** The models that enhance frames, for a list to choose from. */
import type { Kind } from "#viewer/enhance/model/enhancer";
import { OFF } from "#viewer/enhance/model/enhancer";
import { enhancersOf } from "#viewer/enhance/registry";

export const KIND_NAMES: Readonly<Record<Kind, string>> = { restore: "Restore", upscale: "Upscale" };

export function ModelOptions({ kind }: { kind: Kind }) {
  return (
    <>
      <option value={OFF}>Off</option>
      {enhancersOf(kind).map(({ name, label }) => (
        <option key={name} value={name}>
          {label}
        </option>
      ))}
    </>
  );
}
