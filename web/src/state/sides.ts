/** Settings of each picture on the stage: the common settings or, in a comparison, those of its side. */
import { stepOfBitrate } from "../abr/video-ladder";
import { type DashSettings, PRESETS } from "../dash/presets";
import type { Rung } from "../wire/render";
import { isPerView, isStreamed, type Settings, type SideMode } from "./settings";

export const PLACES = ["left", "right"] as const;
export type Place = (typeof PLACES)[number];

/** Settings implied by a side's choice: a mode and its parameters. */
export function modeOf(choice: SideMode): Pick<Settings, "mode"> & Partial<Settings> {
  const preset = PRESETS.find((one) => choice === `dash-${one}`);
  if (preset) return { mode: "dash", dashPreset: preset };
  return { mode: choice as "stateless" | "video" | "webrtc" | "local" };
}

/** Of one picture on the stage. */
export interface SideSettings extends Omit<Settings, "dashRepresentation">, Pick<DashSettings, "dashRepresentation"> {
  /** How many kbit/s it may take; without it, as many as it likes. */
  readonly bitrateKbps?: number;
}

/** Views per second that must fit into a bit rate shared by both sides. */
const VIEWS_PER_S = 20;

/** The settings of one picture; only the mode `side-by-side` has a right one. `ladder`: the one that locks index. */
export function settingsAt(place: Place, settings: Settings, ladder: readonly Rung[] = []): SideSettings {
  if (settings.mode !== "side-by-side") return settings;
  return { ...settings, ...modeOf(settings[place]), ...locked(settings, ladder) };
}

/** Effect of a lock on both sides: nothing adapts, and nothing is refined beyond it. */
function locked({ lock, lockRung, lockKbps }: Settings, ladder: readonly Rung[]): Partial<SideSettings> {
  if (lock === "off" || ladder.length === 0) return {};
  const fixed = { controller: "fixed", refine: false } as const;
  if (lock === "resolution") {
    const profile = Math.min(lockRung, ladder.length - 1);
    return { ...fixed, profile, dashRepresentation: { rung: profile } };
  }
  const fits = ladder.findIndex(({ expected_kb }) => expected_kb * 8 * VIEWS_PER_S <= lockKbps);
  const profile = fits < 0 ? ladder.length - 1 : fits;
  const rung = stepOfBitrate(ladder, lockKbps)[0]?.rung ?? profile;
  return { ...fixed, profile, dashRepresentation: { rung, bitrate_kbps: lockKbps }, bitrateKbps: lockKbps };
}

/** Where there are pictures. */
export function placesOf({ mode }: Settings): readonly Place[] {
  return mode === "side-by-side" ? PLACES : ["left"];
}

/** The settings of all pictures on the stage. */
export function settingsShown(settings: Settings): readonly SideSettings[] {
  return placesOf(settings).map((place) => settingsAt(place, settings));
}

/** Whether any picture on the stage uses per-pose requests, or a stream of the packager. */
export const anyPerView = (settings: Settings) => settingsShown(settings).some(({ mode }) => isPerView(mode));
export const anyStreamed = (settings: Settings) => settingsShown(settings).some(({ mode }) => isStreamed(mode));
