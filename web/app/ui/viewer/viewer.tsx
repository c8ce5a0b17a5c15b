/** The viewer: the stage with its frame, overlays, and the sidebar. */

import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { offerBridge } from "#lab/experiment/bridge";
import { Runner } from "#lab/experiment/runner";
import { ViewerControl } from "#viewer/control/viewer-control";
import { answerParent } from "#viewer/embed/frame-messages";
import { turning } from "#viewer/reproject/acceleration";
import { ViewerSession } from "#viewer/session/session";
import { MODES } from "#viewer/state/settings";
import { keepAddress } from "../../state/address";
import { changeSettings, page, settings } from "../../state/app";
import { linkedPose, linkedSettings } from "../../state/link";
import type { Asked } from "../../state/route";
import { added } from "../../uploads/uploads";
import { ExperimentDialog } from "../experiment/experiment-dialog";
import { TOUCH, useMedia, WIDE } from "../use-media";
import { Freeze } from "./freeze";
import { HelpDialog } from "./help";
import { Hud } from "./hud";
import { linkNote } from "./link-note";
import { MovePad } from "./move-pad";
import { MovementStatus } from "./movement-status";
import { SideFigures } from "./side-figures";
import { Sidebar } from "./sidebar";
import { StageMessage } from "./stage-message";
import { Toolbar } from "./toolbar";
import { useFocusReturn } from "./use-focus-return";
import { useFullscreen } from "./use-fullscreen";
import { useScreenshot } from "./use-screenshot";
import { useShortcuts } from "./use-shortcuts";
import { WalkVerdict } from "./walk-verdict";

interface Props {
  readonly sceneId: string;
  /** That the URL asks for. */
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
  const help = useSignal(false);
  const experiment = useSignal(false);
  const wide = useMedia(WIDE);
  const detailed = !useMedia(TOUCH) && wide;
  const fullscreen = useFullscreen(root);
  /** Fullscreen shows only the picture; the settings open on demand. */
  const besideFullscreen = useSignal(false);
  useEffect(() => {
    if (!fullscreen.on) besideFullscreen.value = false;
  }, [fullscreen.on, besideFullscreen]);

  useEffect(() => {
    if (!stage.current || !left.current || !right.current) return undefined;
    const place = { element: stage.current, left: left.current, right: right.current };
    const current = new ViewerSession(sceneId, place, page);
    session.value = current;
    const movementRunner = new Runner(current);
    const withdraw = offerBridge(movementRunner);
    const leaveAddress = bare ? () => undefined : keepAddress(current);
    const control = new ViewerControl(current);
    const leaveParent = answerParent(control);
    stage.current.focus({ preventScroll: true });
    return () => {
      session.value = null;
      withdraw();
      leaveAddress();
      leaveParent();
      control.destroy();
      movementRunner.dispose();
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
    const pose = linkedPose(asked);
    if (live && entered && pose) live.rig.place(pose);
  }, [asked, live, entered]);

  const picture = useScreenshot(live);
  const { hud, sidebar, mode, drag } = settings.value;
  const sidebarOpen = fullscreen.on ? besideFullscreen.value : (sidebar ?? wide);
  const actions = {
    help: () => {
      help.value = !help.value;
    },
    hud: () => changeSettings({ hud: !hud }),
    sidebar: () => {
      if (fullscreen.on) besideFullscreen.value = !sidebarOpen;
      else changeSettings({ sidebar: !sidebarOpen });
    },
    reset: () => session.value?.rig.resetCamera(),
    mode: () => changeSettings({ mode: MODES[(MODES.indexOf(mode) + 1) % MODES.length] ?? mode }),
    experiment: () => {
      experiment.value = !experiment.value;
    },
    drag: () => changeSettings({ drag: drag === "look" ? "orbit" : "look" }),
    lock: () => void session.value?.input.lock(),
    screenshot: picture.take,
    fullscreen: fullscreen.toggle,
  };
  const stats = live?.source.value?.stats.value;
  const note = linkNote(asked, unknown);
  const phase = live?.phase.value.kind ?? "connecting";
  const usable = phase !== "failed" && !bare;
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
          // biome-ignore lint/a11y/noNoninteractiveTabindex: an application is where keys go
          tabIndex={0}
          role="application"
          aria-label={`${name}: arrow keys turn, W A S D walk, Space and Shift rise and sink, H shows help`}
          data-phase={phase}
          data-transport={live?.connected.value?.transport.kind}
          data-frames={stats?.shown}
          data-settled={stats?.settled}
          data-mode={mode}
          data-sources={live?.sources.value.map((each) => each.phase.value.kind).join(" ")}
          data-shown={live?.sources.value.map((each) => each.stats.value.shown).join(" ")}
        >
          <div class="pane" ref={left} />
          <div class="pane" ref={right} />
        </div>
        {!bare && (
          <Toolbar
            name={name}
            usable={usable}
            actions={actions}
            mode={mode}
            hud={hud}
            sidebar={sidebarOpen}
            saving={picture.busy}
          />
        )}
        {live && entered && hud && usable && <Figures session={live} detailed={detailed} note={note} />}
        {live && usable && <MovePad input={live.input} />}
        {live && <MovementStatus deck={live.movement} />}
        {live && <StageMessage session={live} />}
        {live && <Freeze session={live} />}
        {picture.problem && (
          <p class="floating freeze" role="alert">
            {picture.problem}
          </p>
        )}
        {live && !bare && !sidebarOpen && <WalkVerdict session={live} onOpen={actions.sidebar} />}
      </main>
      {live && usable && sidebarOpen && (
        <Sidebar
          session={live}
          onClose={actions.sidebar}
          onReset={actions.reset}
          onSkip={() => stage.current?.focus({ preventScroll: true })}
        />
      )}
      {help.value && (
        <HelpDialog
          onClose={() => {
            help.value = false;
          }}
        />
      )}
      {live && <ExperimentDialog session={live} open={experiment} />}
    </div>
  );
}

/** Of single pictures with all of their figures, or else of each side in the same form. */
function Figures({ session, detailed, note }: { session: ViewerSession; detailed: boolean; note: string | null }) {
  const source = session.source.value;
  const stats = source?.stats.value;
  if (source === null || stats?.kind !== "requests" || session.right.value) {
    return <SideFigures session={session} detailed={detailed} />;
  }
  return <Hud session={session} source={source} stats={stats} detailed={detailed} linkNote={note} />;
}

/** The link's settings, stored like those chosen by the user. */
function choose(asked: Asked): void {
  changeSettings(linkedSettings(asked));
  if (asked.reprojection === "on") turning.value = "forced";
}
