/** What each picture of the stage is shown by: the settings themselves, or, where two modes are compared, those of its side. */
import { stepOfBitrate } from "../abr/video-ladder";
import { type DashSettings, PRESETS } from "../dash/presets";
import type { Rung } from "../wire/render";
import { isPerView, isStreamed, LOCAL_FORMS, type Settings, type SideMode } from "./settings";

export const PLACES = ["left", "right"] as const;
export type Place = (typeof PLACES)[number];

/** What a side's choice means: a mode, and what belongs to it. */
export function modeOf(choice: SideMode): Pick<Settings, "mode"> & Partial<Settings> {
  const preset = PRESETS.find((one) => choice === `dash-${one}`);
  if (preset) return { mode: "dash", dashPreset: preset };
  const localForm = LOCAL_FORMS.find((form) => choice === `local-${form}`);
  if (localForm) return { mode: "local", localForm };
  return { mode: choice as "stateless" | "video" | "webrtc" };
}

/** Of one picture on the stage. */
export interface SideSettings extends Omit<Settings, "dashRepresentation">, Pick<DashSettings, "dashRepresentation"> {
  /** How many kbit/s it may take; without it, as many as it likes. */
  readonly bitrateKbps?: number;
}

/** So many views a second are to fit into a bit rate that both sides have in common. */
const VIEWS_PER_S = 20;

/** The settings of one picture; in every mode but `side-by-side` there is only the left one. `ladder`: what locks count in. */
export function settingsAt(place: Place, settings: Settings, ladder: readonly Rung[] = []): SideSettings {
  if (settings.mode !== "side-by-side") return settings;
  return { ...settings, ...modeOf(settings[place]), ...locked(settings, ladder) };
}

/** What a lock decides of every side: nothing adapts, and nothing is refined beyond it. */
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

/** Those of all pictures on the stage. */
export function settingsShown(settings: Settings): readonly SideSettings[] {
  return placesOf(settings).map((place) => settingsAt(place, settings));
}

/** Whether any picture on the stage asks for each view by itself, or plays a stream of the packager's. */
export const anyPerView = (settings: Settings) => settingsShown(settings).some(({ mode }) => isPerView(mode));
export const anyStreamed = (settings: Settings) => settingsShown(settings).some(({ mode }) => isStreamed(mode));
