/** The models that enhance frames, for a list to choose from. */
import type { Kind } from "../enhance/model/enhancer";
import { OFF } from "../enhance/model/enhancer";
import { enhancersOf } from "../enhance/registry";

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
