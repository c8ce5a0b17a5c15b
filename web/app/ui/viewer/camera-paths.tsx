/** Camera paths that are saved with the scene: add keyframes, play a path, save it, and make a video of it. */
import { signal } from "@preact/signals";
import { Play, Plus, Square, X } from "lucide";
import { useState } from "preact/hooks";
import type { SceneInfo } from "#client/wire/render";
import type { ViewerSession } from "#viewer/session/session";
import { IconButton, QuietButton } from "../button";
import { Check, NumberField, RadioList, Select } from "../fields";
import { clock } from "../format";
import { Question } from "../question";
import { edit, freeName, mayEdit, NameForm, taken } from "./name-form";
import {
  draftOf,
  durationOf,
  emptyPath,
  MAX_KEYFRAMES,
  type PathDraft,
  stopsOf,
  withDuration,
  withLoop,
  withoutStop,
  withStop,
} from "./path-draft";
import { SaveVideo } from "./save-video";
import { goTo, pathOf, play, playing, presentPose } from "./saved-places";

const EASINGS: Readonly<Record<PathDraft["easing"], string>> = {
  "ease-in-out": "Smooth",
  "ease-in": "Slow start",
  "ease-out": "Slow end",
  linear: "Constant",
};
/** Stands in for a saved path's name. */
const NEW = "";

/** Unsaved changes by the saved path's name; kept while the lab is closed. */
interface Work {
  readonly scene: string;
  readonly chosen: string;
  readonly drafts: ReadonlyMap<string, PathDraft>;
}

const work = signal<Work>({ scene: "", chosen: NEW, drafts: new Map() });

interface Props {
  readonly session: ViewerSession;
}

export function CameraPaths({ session }: Props) {
  const scene = session.scene.value;
  return scene === null ? null : <Paths session={session} scene={scene} />;
}

function Paths({ session, scene }: Props & { readonly scene: SceneInfo }) {
  const { paths = {} } = scene;
  const { chosen, drafts } = work.value.scene === scene.id ? work.value : { chosen: NEW, drafts: new Map() };
  const saved = Object.hasOwn(paths, chosen) ? paths[chosen] : undefined;
  const draft: PathDraft = drafts.get(chosen) ?? (saved ? draftOf(chosen, saved) : emptyPath(freeName("Path", paths)));
  const change = (next: PathDraft) => {
    work.value = { scene: scene.id, chosen, drafts: new Map(drafts).set(chosen, next) };
  };
  /** Discards the path's changes, and shows another path. */
  const leave = (next: string) => {
    work.value = { scene: scene.id, chosen: next, drafts: new Map([...drafts].filter(([name]) => name !== chosen)) };
  };
  const choose = (next: string) => {
    work.value = { scene: scene.id, chosen: next, drafts };
  };
  const ready = stopsOf(draft).length > 1;
  return (
    <div class="camera-paths stack">
      {Object.keys(paths).length > 0 && (
        <RadioList
          name="path"
          label="Camera path"
          boxed
          rows={[...Object.keys(paths), NEW].map((name) => ({
            key: name,
            title: name === NEW ? "New path" : name,
            detail: drafts.has(name) ? "unsaved" : paths[name] && clock(paths[name].keyframes.at(-1)?.t_ms ?? 0),
          }))}
          chosen={saved ? chosen : NEW}
          onChoose={choose}
        />
      )}
      <Keyframes session={session} draft={draft} onChange={change} />
      {ready && <Timing draft={draft} onChange={change} />}
      {ready && <PlayButton session={session} draft={draft} />}
      {ready && <SaveVideo session={session} of="path" name={draft.name} path={() => pathOf(draft)} />}
      {mayEdit(scene) && (ready || saved) && (
        <SavePath
          session={session}
          scene={scene}
          saved={saved && chosen}
          draft={draft}
          onChange={change}
          onLeave={leave}
        />
      )}
      {drafts.has(chosen) && <QuietButton onClick={() => leave(saved ? chosen : NEW)}>Discard changes</QuietButton>}
    </div>
  );
}

interface DraftProps {
  readonly draft: PathDraft;
  readonly onChange: (draft: PathDraft) => void;
}

function Keyframes({ session, draft, onChange }: Props & DraftProps) {
  const stops = stopsOf(draft);
  return (
    <>
      {stops.length > 0 && (
        <ol class="saved-places">
          {stops.map((stop, index) => (
            // biome-ignore lint/suspicious/noArrayIndexKey: keyframes have no identity other than their position
            <li key={index} class="row">
              <QuietButton title="Go to this view" onClick={() => goTo(session, stop)}>
                Keyframe {index + 1} <span class="muted">{clock(stop.t_ms)}</span>
              </QuietButton>
              <IconButton
                icon={X}
                label={`Remove keyframe ${index + 1}`}
                onClick={() => onChange(withoutStop(draft, index))}
              />
            </li>
          ))}
        </ol>
      )}
      <QuietButton
        icon={Plus}
        disabled={draft.keyframes.length >= MAX_KEYFRAMES}
        onClick={() => onChange(withStop(draft, presentPose(session)))}
      >
        Add this view as a keyframe
      </QuietButton>
      {stops.length < 2 && (
        <p class="muted small">The camera flies through the views you add, in order. Add at least two.</p>
      )}
      {draft.keyframes.length >= MAX_KEYFRAMES && (
        <p class="muted small">A path can have at most {MAX_KEYFRAMES} keyframes.</p>
      )}
    </>
  );
}

function Timing({ draft, onChange }: DraftProps) {
  return (
    <>
      <div class="fields">
        <NumberField
          label="Duration"
          unit="s"
          min={0.1}
          max={3600}
          value={Math.round(durationOf(draft) / 10) / 100}
          onValue={(seconds) => onChange(withDuration(draft, 1000 * seconds))}
        />
        <Select
          label="Speed"
          value={draft.easing}
          options={Object.entries(EASINGS)}
          onValue={(easing) => onChange({ ...draft, easing: easing as PathDraft["easing"] })}
        />
      </div>
      <Check
        checked={draft.loop}
        disabled={!draft.loop && draft.keyframes.length >= MAX_KEYFRAMES}
        onChange={() => onChange(withLoop(draft, !draft.loop))}
      >
        Loop back to the start
      </Check>
    </>
  );
}

function PlayButton({ session, draft }: Props & { readonly draft: PathDraft }) {
  const plays = playing.value === session;
  return (
    <QuietButton
      icon={plays ? Square : Play}
      onClick={() => (plays ? session.rig.takeOver() : void play(session, draft))}
    >
      {plays ? "Stop path" : "Play path"}
    </QuietButton>
  );
}

interface SavePathProps extends Props, DraftProps {
  readonly scene: SceneInfo;
  /** The name under which the path is saved. */
  readonly saved: string | undefined;
  /** Called when the path was saved or deleted, to show another. */
  readonly onLeave: (next: string) => void;
}

function SavePath({ session, scene, saved, draft, onChange, onLeave }: SavePathProps) {
  const [deleting, setDeleting] = useState(false);
  const save = async (name: string) => {
    const { easing, loop } = draft;
    const path = { keyframes: [...draft.keyframes], easing, loop };
    const former = saved !== undefined && saved !== name ? { [saved]: null } : {};
    await edit(session, scene.id, { paths: { ...former, [name]: path } });
    onLeave(name);
  };
  return (
    <>
      <NameForm
        label="Path name"
        verb="Save path"
        name={draft.name}
        onName={(name) => onChange({ ...draft, name })}
        disabled={stopsOf(draft).length < 2}
        refuse={(name) => (name !== saved && Object.hasOwn(scene.paths ?? {}, name) ? taken("path", name) : null)}
        save={save}
      >
        {saved !== undefined && <QuietButton onClick={() => setDeleting(true)}>Delete path</QuietButton>}
      </NameForm>
      {saved !== undefined && deleting && (
        <Question
          title={`Delete “${saved}”?`}
          verb="Delete"
          action={() => edit(session, scene.id, { paths: { [saved]: null } })}
          onDone={() => onLeave(NEW)}
          onClose={() => setDeleting(false)}
        >
          <p>The path will be deleted for everyone. This cannot be undone.</p>
        </Question>
      )}
    </>
  );
}
