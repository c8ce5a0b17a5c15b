/**
 * The modes, by name. To add one, write a file that exports its `SourceKind` and one with its source, loaded on demand;
 * list it here, and name it in the Python wire types (`SOURCES` in tigas_experiments/wire/run.py), which experiments share.
 */
import type { SideMode, SourceName } from "../state/settings";
import { DASH } from "./dash";
import { LOCAL } from "./local";
import { STATELESS } from "./pictures";
import type { SourceKind, Variant } from "./source";
import { VIDEO } from "./video";
import { WEBRTC } from "./webrtc";

export const SOURCES: Readonly<Record<SourceName, SourceKind>> = {
  stateless: STATELESS,
  video: VIDEO,
  dash: DASH,
  webrtc: WEBRTC,
  local: LOCAL,
};

/** The choices for a side of a comparison, each with the settings that it implies. */
export const VARIANTS = Object.entries(SOURCES).flatMap(([mode, { title, variants }]) =>
  (variants ?? [{ name: mode, title, settings: {} }]).map(({ settings, ...variant }) => ({
    ...variant,
    settings: { ...settings, mode: mode as SourceName },
  })),
);

/** The choice with this name. Throws if there is none. */
export function variantOf(name: SideMode): Variant & { readonly settings: { readonly mode: SourceName } } {
  const variant = VARIANTS.find((one) => one.name === name);
  if (variant === undefined) throw new Error(`there is no mode ${name}`);
  return variant;
}
