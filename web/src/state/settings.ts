/** What a person chose, kept in the browser. Anything there that does not make sense is replaced by its default. */
import * as v from "valibot";

const Settings = v.object({
  theme: v.fallback(v.picklist(["system", "light", "dark"]), "system"),
  transport: v.fallback(v.picklist(["auto", "webtransport-streams", "webtransport-datagrams", "fetch"]), "auto"),
  /** The ladder's rung. */
  profile: v.fallback(v.pipe(v.number(), v.integer(), v.minValue(0), v.maxValue(255)), 0),
  /** When the camera stands still, ask for the view once more at the best rung. */
  refine: v.fallback(v.boolean(), true),
  /** Degrees a second. */
  turnSpeed: v.fallback(v.pipe(v.number(), v.minValue(1), v.maxValue(720)), 60),
  /** Null: open where there is room. */
  sidebar: v.fallback(v.nullable(v.boolean()), null),
  hud: v.fallback(v.boolean(), true),
  /** All of the HUD's numbers, or the most important ones; null: all where there is room. */
  hudDetails: v.fallback(v.nullable(v.boolean()), null),
});

export type Settings = v.InferOutput<typeof Settings>;

export const DEFAULT_SETTINGS: Settings = v.parse(Settings, {});

const KEY = "tigas.settings";

/** The part of localStorage that is used; some browsers throw on any access. */
export type Store = Pick<Storage, "getItem" | "setItem">;

export function loadSettings(store: Store): Settings {
  try {
    const result = v.safeParse(Settings, JSON.parse(store.getItem(KEY) ?? "{}"));
    return result.success ? result.output : DEFAULT_SETTINGS;
  } catch {
    return DEFAULT_SETTINGS;
  }
}

export function saveSettings(store: Store, settings: Settings): void {
  try {
    store.setItem(KEY, JSON.stringify(settings));
  } catch {
    // a private window or a full disk: the settings last as long as the page
  }
}
