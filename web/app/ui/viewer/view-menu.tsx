/** A visitor's settings: how pictures are made, their quality, dragging and the theme. */

import { RotateCcw } from "lucide";
import type { SceneInfo, ServerConfig } from "#client/wire/render";
import type { ViewerSession } from "#viewer/session/session";
import { SOURCES } from "#viewer/sources/registry";
import { applies, kindsShown } from "#viewer/sources/sides";
import { COMPARED, DEFAULT_SETTINGS, type Mode, type Settings, type SourceName } from "#viewer/state/settings";
import { config, ladder, settings } from "../../state/app";
import { QuietButton } from "../button";
import { useWindowEvent } from "../hooks";
import { goTo, play, SavedPlaces } from "./saved-places";
import { SegmentList, Segments } from "./setting";

interface Props {
  readonly session: ViewerSession;
  readonly onReset: () => void;
  readonly onClose: () => void;
}

export function ViewMenu({ session, onReset, onClose }: Props) {
  useWindowEvent("pointerdown", ({ target }) => {
    const inside = target instanceof Element && target.closest("#view-menu, [aria-controls=view-menu]");
    if (!inside) onClose();
  });
  useWindowEvent("keydown", ({ key }) => {
    if (key !== "Escape") return;
    const inside = document.activeElement?.closest("#view-menu");
    if (inside) document.querySelector<HTMLElement>("[aria-controls=view-menu]")?.focus();
    onClose();
  });
  return (
    <fieldset class="floating view-menu stack" id="view-menu" aria-label="View">
      <Saved session={session} onClose={onClose} />
      <Picture session={session} />
      {applies("controller", settings.value) && <Quality />}
      <Segments name="drag" headed />
      <Segments name="theme" headed />
      <QuietButton icon={RotateCcw} onClick={onReset}>
        Back to the start
      </QuietButton>
    </fieldset>
  );
}

/** The scene's saved views and camera paths, if it has any. */
function Saved({ session, onClose }: Pick<Props, "session" | "onClose">) {
  const { views = {}, paths = {} } = session.scene.value ?? {};
  const go = (name: string) => {
    onClose();
    if (views[name]) goTo(session, views[name]);
  };
  const start = (name: string) => {
    onClose();
    if (paths[name]) void play(session, paths[name]);
  };
  return (
    <>
      <SavedPlaces places={views} heading="Saved views" title="Go to this view" onChoose={go} />
      <SavedPlaces places={paths} heading="Camera paths" title="Play this path" onChoose={start} />
    </>
  );
}

function Picture({ session }: Pick<Props, "session">) {
  const scene = session.scene.value;
  if (scene === null) return null;
  const present = wayOf(settings.value.mode);
  return (
    <SegmentList
      name="way"
      label="Picture"
      headed
      choices={waysOffered(settings.value, config.value, scene).map((way) => ({
        title: way.title,
        chosen: way === present,
        part: { mode: way.mode },
      }))}
    />
  );
}

/** Automatic, or a rung: the sharpest, or one in the middle of the ladder, which is faster. */
function Quality() {
  const { controller, profile } = settings.value;
  const fast = Math.floor(ladder.value.length / 2);
  const fixed = (title: string, rung: number) => ({
    title,
    chosen: controller === "fixed" && profile === rung,
    part: { controller: "fixed", profile: rung } as const,
  });
  const auto = {
    title: "Auto",
    chosen: controller !== "fixed",
    part: { controller: DEFAULT_SETTINGS.controller },
  };
  const sharp = fixed("Sharp", 0);
  const choices = [auto, sharp, { ...fixed("Fast", fast), ...(fast === 0 && { chosen: false }) }];
  return <SegmentList name="quality" label="Quality" headed choices={choices} />;
}

/** A mode in a visitor's terms: how pictures are made, without the details of their delivery. */
interface Way {
  readonly title: string;
  /** The mode that it starts with. */
  readonly mode: Mode;
}

const STREAM: Way = { title: "Stream", mode: DEFAULT_SETTINGS.mode };
const COMPARE: Way = { title: "Compare", mode: COMPARED };
const HERE = (Object.keys(SOURCES) as SourceName[])
  .filter((name) => SOURCES[name].drawsHere)
  .map((mode): Way => ({ title: "On this device", mode }));

function wayOf(mode: Mode): Way {
  return [COMPARE, ...HERE].find((way) => way.mode === mode) ?? STREAM;
}

/** All ways that this server offers for the scene, and the current one. */
function waysOffered(settings: Settings, config: ServerConfig | null, scene: SceneInfo): readonly Way[] {
  return [STREAM, COMPARE, ...HERE].filter(
    (way) =>
      way === wayOf(settings.mode) ||
      kindsShown({ ...settings, mode: way.mode }).every((kind) => kind.missing(config, scene) === null),
  );
}
