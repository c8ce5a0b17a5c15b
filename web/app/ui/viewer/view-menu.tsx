/** A visitor's settings: how the picture comes about, its quality, dragging and the theme. */

import { RotateCcw } from "lucide";
import { useEffect, useRef } from "preact/hooks";
import type { ViewerSession } from "#viewer/session/session";
import { applies } from "#viewer/sources/sides";
import { DEFAULT_SETTINGS, type Settings } from "#viewer/state/settings";
import { changeSettings, config, ladder, settings } from "../../state/app";
import { Icon } from "../icon";
import { goTo, play, SavedPlaces } from "./saved-places";
import { Segment, SegmentList } from "./setting";
import { wayOf, waysOffered } from "./ways";

interface Props {
  readonly session: ViewerSession;
  readonly onReset: () => void;
  readonly onClose: () => void;
}

const DRAGS = { look: "Look around", orbit: "Orbit" } as const;
const THEMES = { system: "System", light: "Light", dark: "Dark" } as const;

export function ViewMenu({ session, onReset, onClose }: Props) {
  const menu = useRef<HTMLFieldSetElement>(null);
  useEffect(() => {
    const listening = new AbortController();
    const outside = ({ target }: Event) =>
      target instanceof Element && !menu.current?.contains(target) && !target.closest("[aria-controls=view-menu]");
    const press = ({ key }: KeyboardEvent) => key === "Escape" && onClose();
    addEventListener("pointerdown", (event) => outside(event) && onClose(), { signal: listening.signal });
    addEventListener("keydown", press, { signal: listening.signal });
    return () => listening.abort();
  }, [onClose]);
  return (
    <fieldset class="floating view-menu" id="view-menu" aria-label="View" ref={menu}>
      <Saved session={session} onClose={onClose} />
      <Picture session={session} />
      {applies("controller", settings.value) && <Quality />}
      <Options name="drag" label="Drag to" options={DRAGS} />
      <Options name="theme" label="Theme" options={THEMES} />
      <button type="button" class="quiet-button with-icon" onClick={onReset}>
        <Icon of={RotateCcw} size={14} /> Back to the start
      </button>
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
    <SegmentList name="way" label="Picture" headed>
      {waysOffered(settings.value, config.value, scene).map((way) => (
        <Segment
          key={way.mode}
          name="way"
          checked={way === present}
          onChoose={() => changeSettings({ mode: way.mode })}
        >
          {way.title}
        </Segment>
      ))}
    </SegmentList>
  );
}

/** Automatic, or a rung: the sharpest, or one in the middle of the ladder, which comes sooner. */
function Quality() {
  const { controller, profile } = settings.value;
  const fast = Math.floor(ladder.value.length / 2);
  const choices = [
    { title: "Auto", chosen: controller !== "fixed", settings: { controller: DEFAULT_SETTINGS.controller } },
    { title: "Sharp", chosen: controller === "fixed" && profile === 0, settings: { controller: "fixed", profile: 0 } },
    {
      title: "Fast",
      chosen: controller === "fixed" && profile === fast && fast > 0,
      settings: { controller: "fixed", profile: fast },
    },
  ] as const;
  return (
    <SegmentList name="quality" label="Quality" headed>
      {choices.map(({ title, chosen, settings: part }) => (
        <Segment key={title} name="quality" checked={chosen} onChoose={() => changeSettings(part)}>
          {title}
        </Segment>
      ))}
    </SegmentList>
  );
}

function Options<Name extends "drag" | "theme">({
  name,
  label,
  options,
}: {
  readonly name: Name;
  readonly label: string;
  readonly options: Readonly<Record<Settings[Name], string>>;
}) {
  return (
    <SegmentList name={name} label={label} headed>
      {Object.entries<string>(options).map(([value, title]) => (
        <Segment
          key={value}
          name={name}
          checked={settings.value[name] === value}
          onChoose={() => changeSettings({ [name]: value })}
        >
          {title}
        </Segment>
      ))}
    </SegmentList>
  );
}
