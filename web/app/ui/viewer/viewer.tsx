/** The viewer: the stage with its frame, overlays, and the sidebar. */
import { useComputed, useSignal } from "@preact/signals";
import { useEffect, useRef, useState } from "preact/hooks";
import { turning } from "#viewer/reproject/acceleration";
import { ViewerSession } from "#viewer/session/session";
import { MODES } from "#viewer/state/settings";
import { keepAddress } from "../../state/address";
import { changeSettings, page, settings } from "../../state/app";
import { linkedPose, linkedSettings, linkNote } from "../../state/link";
import type { Asked } from "../../state/route";
import { added } from "../../uploads/uploads";
import { TOUCH, useMedia, WIDE } from "../hooks";
import { lazy } from "../lazy";
import { useFocusReturn, useFullscreen, useScreenshot, useShortcuts } from "./hooks";
import { Sidebar } from "./sidebar";
import { Freeze, StageMessage } from "./stage-message";
import { Hint, StatusLines } from "./status-line";
import { Toolbar } from "./toolbar";

const ExperimentDialog = lazy(async () => (await import("../experiment/experiment-dialog")).ExperimentDialog);
const Figures = lazy(async () => (await import("./side-figures")).Figures);
const HelpDialog = lazy(async () => (await import("./help")).HelpDialog);
const MovePad = lazy(async () => (await import("./move-pad")).MovePad, { quiet: true });
const MovementStatus = lazy(async () => (await import("./movement-status")).MovementStatus, { quiet: true });
const WalkVerdict = lazy(async () => (await import("./last-walk")).WalkVerdict, { quiet: true });

interface Props {
  readonly sceneId: string;
  /** Settings and pose requested by the URL. */
  readonly asked: Asked;
  /** Unknown values in the link. */
  readonly unknown?: readonly string[] | undefined;
  /** Without any controls, as in a frame of another page. */
  readonly bare?: boolean;
}

export function Viewer({ sceneId, asked, unknown, bare = false }: Props) {
  const root = useRef<HTMLDivElement>(null);
  const stage = useRef<HTMLDivElement>(null);
  const left = useRef<HTMLDivElement>(null);
  const right = useRef<HTMLDivElement>(null);
  const session = useSignal<ViewerSession | null>(null);
  const [help, setHelp] = useState(false);
  const experiment = useSignal(false);
  /** The dialog keeps its form while it is closed. */
  const [prepared, setPrepared] = useState(false);
  const wide = useMedia(WIDE);
  const touch = useMedia(TOUCH);
  const roomy = !touch && wide;
  const fullscreen = useFullscreen(root);
  /** Fullscreen shows only the picture; the settings open on demand. */
  const [besideFullscreen, setBesideFullscreen] = useState(false);
  useEffect(() => {
    if (!fullscreen.on) setBesideFullscreen(false);
  }, [fullscreen.on]);

  useEffect(() => {
    if (!stage.current || !left.current || !right.current) return undefined;
    const place = { element: stage.current, left: left.current, right: right.current };
    const current = new ViewerSession(sceneId, place, page);
    session.value = current;
    const withdraw = offerScripts(current);
    const leaveAddress = bare ? () => undefined : keepAddress(current);
    stage.current.focus({ preventScroll: true });
    return () => {
      session.value = null;
      withdraw();
      leaveAddress();
      current.dispose();
    };
  }, [sceneId, session, bare]);

  const live = session.value;
  useEffect(() => {
    if (live) choose(asked);
  }, [asked, live]);
  const entered = live?.scene.value != null;
  useEffect(() => {
    if (entered) added.value = new Set([...added.peek()].filter((id) => id !== sceneId));
  }, [entered, sceneId]);
  useEffect(() => {
    const pose = linkedPose(asked, live?.scene.peek()?.views);
    if (live && entered && pose) live.rig.place(pose);
  }, [asked, live, entered]);

  const picture = useScreenshot(live);
  const { hud, hudDetails, hint, sidebar, mode, drag } = settings.value;
  const sidebarOpen = fullscreen.on ? besideFullscreen : sidebar;
  const actions = {
    help: () => setHelp(!help),
    hud: () => changeSettings({ hud: !hud }),
    sidebar: () => {
      if (fullscreen.on) setBesideFullscreen(!sidebarOpen);
      else changeSettings({ sidebar: !sidebarOpen });
    },
    reset: () => session.value?.rig.resetCamera(),
    mode: () => changeSettings({ mode: MODES[(MODES.indexOf(mode) + 1) % MODES.length] ?? mode }),
    experiment: () => {
      setPrepared(true);
      experiment.value = !experiment.value;
    },
    drag: () => changeSettings({ drag: drag === "look" ? "orbit" : "look" }),
    lock: () => void session.value?.input.lock(),
    screenshot: picture.take,
    fullscreen: fullscreen.toggle,
  };
  const note = linkNote(asked, unknown, live?.scene.value);
  /** Attributes of the stage, computed so that their changes do not render the whole viewer again. */
  const stats = useComputed(() => session.value?.source.value?.stats.value);
  const sources = useComputed(() => session.value?.sources.value);
  const frames = useComputed(() => stats.value?.shown);
  const settled = useComputed(() => stats.value?.settled);
  const playing = useComputed(() => sources.value?.map((each) => each.phase.value.kind).join(" "));
  const shown = useComputed(() => sources.value?.map((each) => each.stats.value.shown).join(" "));
  const phase = live?.phase.value.kind ?? "connecting";
  const usable = phase !== "failed" && !bare;
  const compared = (live?.comparison.value?.sides.length ?? 0) > 1;
  const measured = live && entered && hud && usable ? live : null;
  const Measurements = (hudDetails ?? (sidebarOpen && roomy)) ? Figures : StatusLines;
  useShortcuts(actions, !usable);
  useFocusReturn(root, stage);

  const name = live?.scene.value?.name ?? sceneId;
  useEffect(() => {
    document.title = `${name} · TIGAS`;
  }, [name]);

  return (
    <div class="viewer" ref={root} data-sidebar={usable && sidebarOpen ? "open" : "closed"}>
      <main class="stage-area">
        <div
          class="stage"
          ref={stage}
          // biome-ignore lint/a11y/noNoninteractiveTabindex: an application receives the keys
          tabIndex={0}
          role="application"
          aria-label={`${name}: arrow keys turn, W A S D walk, Space and Shift move up and down, H shows help`}
          data-phase={phase}
          data-transport={live?.connected.value?.transport.kind}
          data-frames={frames}
          data-settled={settled}
          data-mode={mode}
          data-sources={playing}
          data-shown={shown}
        >
          <div class="pane" ref={left} />
          <div class="pane" ref={right} />
        </div>
        {measured && <Measurements session={measured} linkNote={note} />}
        {measured && hint && !(compared && Measurements === Figures) && <Hint rig={measured.rig} />}
        {live && usable && touch && <MovePad input={live.input} />}
        {live && <MovementStatus deck={live.movement} bare={bare} />}
        {live && <StageMessage session={live} />}
        {live && <Freeze session={live} />}
        {picture.problem && (
          <p class="floating freeze row small" role="alert">
            {picture.problem}
          </p>
        )}
        {live && compared && !bare && !sidebarOpen && <WalkVerdict session={live} onOpen={actions.sidebar} />}
        {!bare && (
          <Toolbar
            name={name}
            session={usable ? live : null}
            actions={actions}
            lab={sidebarOpen}
            saving={picture.busy}
          />
        )}
      </main>
      {live && usable && sidebarOpen && (
        <Sidebar session={live} actions={actions} onSkip={() => stage.current?.focus({ preventScroll: true })} />
      )}
      {help && <HelpDialog onClose={() => setHelp(false)} />}
      {live && prepared && <ExperimentDialog session={live} open={experiment} />}
    </div>
  );
}

/** Offers `window.tigas` once its code is loaded; returns a function that withdraws it. */
function offerScripts(session: ViewerSession): () => void {
  let withdraw: (() => void) | null = () => undefined;
  import("./scripts").then(
    ({ offer }) => {
      if (withdraw) withdraw = offer(session);
    },
    () => undefined, // the page reports that it is outdated
  );
  return () => {
    withdraw?.();
    withdraw = null;
  };
}

/** Applies the link's settings, which are stored like the user's own. */
function choose(asked: Asked): void {
  changeSettings(linkedSettings(asked));
  if (asked.reprojection === "on") turning.value = "forced";
}
