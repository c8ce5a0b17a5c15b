/** The modes in a visitor's words: how the picture comes about, without the details of its delivery. */
import type { SceneInfo, ServerConfig } from "#client/wire/render";
import { SOURCES } from "#viewer/sources/registry";
import { kindsShown } from "#viewer/sources/sides";
import { COMPARED, DEFAULT_SETTINGS, type Mode, type Settings, type SourceName } from "#viewer/state/settings";

export interface Way {
  readonly title: string;
  /** The mode that it begins with. */
  readonly mode: Mode;
}

const STREAM: Way = { title: "Stream", mode: DEFAULT_SETTINGS.mode };
const COMPARE: Way = { title: "Compare", mode: COMPARED };
const HERE = (Object.keys(SOURCES) as SourceName[])
  .filter((name) => SOURCES[name].drawsHere)
  .map((mode): Way => ({ title: "On this device", mode }));

export function wayOf(mode: Mode): Way {
  return [COMPARE, ...HERE].find((way) => way.mode === mode) ?? STREAM;
}

/** Those that this server offers for the scene, and the present one. */
export function waysOffered(settings: Settings, config: ServerConfig | null, scene: SceneInfo): readonly Way[] {
  return [STREAM, COMPARE, ...HERE].filter(
    (way) =>
      way === wayOf(settings.mode) ||
      kindsShown({ ...settings, mode: way.mode }).every((kind) => kind.missing(config, scene) === null),
  );
}
