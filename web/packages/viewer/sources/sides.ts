/** Settings of each picture on the stage: the common settings or, in a comparison, its side's own. */
import { stepOfBitrate } from "#client/abr/video-ladder";
import type { Rung } from "#client/wire/render";
import { COMPARED, type Mode, PLACES, type Place, type Settings, type SideSettings } from "../state/settings";
import { SOURCES, variantOf } from "./registry";
import type { SourceKind } from "./source";

/** Views per second that must fit into a bit rate shared by both sides. */
const VIEWS_PER_S = 20;

/** The settings of one picture; only the mode `side-by-side` has a right one. `ladder` is the one that locks index. */
export function settingsAt(place: Place, settings: Settings, ladder: readonly Rung[] = []): SideSettings {
  const { mode } = settings;
  if (mode !== COMPARED) return { ...settings, mode };
  return { ...settings, ...variantOf(settings[place]).settings, ...locked(settings, ladder) };
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

function placesOf({ mode }: Settings): readonly Place[] {
  return mode === COMPARED ? PLACES : ["left"];
}

export function settingsShown(settings: Settings): readonly SideSettings[] {
  return placesOf(settings).map((place) => settingsAt(place, settings));
}

export function kindsShown(settings: Settings): readonly SourceKind[] {
  return settingsShown(settings).map(({ mode }) => SOURCES[mode]);
}

/** Whether a setting affects any picture on the stage. */
export function applies(name: keyof Settings, settings: Settings): boolean {
  return kindsShown(settings).some((kind) => kind.settings.includes(name));
}

/** Whether delivery restarts on any side when settings change. */
export function reopens(before: Settings, after: Settings): boolean {
  const [old, now] = [settingsShown(before), settingsShown(after)];
  return (
    before.mode !== after.mode ||
    now.some((side, i) => {
      const names = SOURCES[side.mode].reopens;
      return side.mode !== old[i]?.mode || names.some((name) => side[name] !== old[i]?.[name]);
    })
  );
}

export function titleOf(mode: Mode): string {
  return mode === COMPARED ? "Side by side" : SOURCES[mode].title;
}

/** Labels of the pictures on the stage: the mode, or the compared options. */
export function sideTitles(settings: Settings): readonly string[] {
  const { mode } = settings;
  return mode === COMPARED ? PLACES.map((place) => variantOf(settings[place]).title) : [titleOf(mode)];
}
