/** The viewer: the stage with its frame, what floats over it, and the sidebar. */

import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { KINDS, OFF } from "../../enhance/model/enhancer";
import { nameProblem } from "../../enhance/registry";
import { offerBridge } from "../../experiment/bridge";
import { Runner } from "../../experiment/runner";
import { changeSettings, settings } from "../../state/app";
import { linkedPose, linkedSettings } from "../../state/link";
import type { Asked } from "../../state/route";
import { isPerView, MODES } from "../../state/settings";
import { keepAddress } from "../../viewer/address";
import { ViewerSession } from "../../viewer/session";
import { ExperimentDialog } from "../experiment/experiment-dialog";
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
import { useShortcuts } from "./use-shortcuts";
import { useWide } from "./use-wide";
import { WalkVerdict } from "./walk-verdict";

interface Props {
  readonly sceneId: string;
  /** Frames carry their pose's number. */
  readonly stamp: boolean;
  /** That the URL asks for. */
  readonly asked: Asked;
  /** That it names, too, and that means nothing. */
  readonly unknown?: readonly string[] | undefined;
}

export function Viewer({ sceneId, stamp, asked, unknown }: Props) {
  const root = useRef<HTMLDivElement>(null);
  const stage = useRef<HTMLDivElement>(null);
  const left = useRef<HTMLDivElement>(null);
  const right = useRef<HTMLDivElement>(null);
  const session = useSignal<ViewerSession | null>(null);
  const runner = useSignal<Runner | null>(null);
  const help = useSignal(false);
  const experiment = useSignal(false);
  const locked = useSignal(false);
  const wide = useWide();
  const fullscreen = useFullscreen(root);
  /** Fullscreen is for the picture: the settings are there once they are asked for. */
  const besideFullscreen = useSignal(false);
  useEffect(() => {
    if (!fullscreen.on) besideFullscreen.value = false;
  }, [fullscreen.on, besideFullscreen]);

  useEffect(() => {
    if (!stage.current || !left.current || !right.current) return undefined;
    const place = { element: stage.current, left: left.current, right: right.current };
    const current = new ViewerSession(sceneId, place, stamp);
    session.value = current;
    const movementRunner = new Runner(current);
    runner.value = movementRunner;
    const withdraw = offerBridge(movementRunner);
    const leaveAddress = keepAddress(current);
    stage.current.focus({ preventScroll: true });
    return () => {
      session.value = null;
      runner.value = null;
      withdraw();
      leaveAddress();
      movementRunner.dispose();
      current.dispose();
    };
  }, [sceneId, stamp, session, runner]);

  const live = session.value;
  useEffect(() => {
    if (live) choose(asked, live);
  }, [asked, live]);
  const entered = live?.scene.value != null;
  useEffect(() => {
    const pose = linkedPose(asked);
    if (live && entered && pose) live.rig.place(pose);
  }, [asked, live, entered]);

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
    mode: () => changeSettings({ mode: MODES[(MODES.indexOf(mode) + 1) % MODES.length] ?? "stateless" }),
    experiment: () => {
      experiment.value = !experiment.value;
    },
    drag: () => changeSettings({ drag: drag === "look" ? "orbit" : "look" }),
    lock: () => void session.value?.input.lock(),
    fullscreen: fullscreen.toggle,
  };
  useShortcuts(actions, locked.value);
  useFocusReturn(root, stage);

  const phase = live?.phase.value.kind ?? "connecting";
  const name = live?.scene.value?.name ?? sceneId;
  useEffect(() => {
    document.title = `${name} · TIGAS`;
  }, [name]);

  return (
    <div class="viewer" ref={root} data-sidebar={sidebarOpen ? "open" : "closed"}>
      <main class="stage-area" inert={locked.value}>
        <div
          class="stage"
          ref={stage}
          // biome-ignore lint/a11y/noNoninteractiveTabindex: an application is where keys go
          tabIndex={0}
          role="application"
          aria-label={`${name}: arrow keys turn, W A S D walk, Space and Shift rise and sink, H shows help`}
          data-phase={phase}
          data-transport={live?.stateless.stats.value.transport}
          data-frames={live?.stateless.stats.value.shown}
          data-settled={live?.stateless.stats.value.settled}
          data-mode={mode}
          data-stream={live?.stream.value?.phase.value.kind ?? "off"}
          data-stream-frames={live?.stream.value?.stats.value.shown}
          data-local={live?.local.value?.phase.value.kind ?? "off"}
          data-local-complete={live?.local.value?.stats.value.completeMs != null}
        >
          <div class="pane" ref={left} />
          <div class="pane" ref={right} />
        </div>
        <Toolbar name={name} actions={actions} mode={mode} hud={hud} sidebar={sidebarOpen} />
        {live && entered && hud && phase !== "failed" && isPerView(mode) && (
          <Hud session={live} wide={wide} linkNote={linkNote(asked, unknown)} />
        )}
        {live && entered && hud && phase !== "failed" && !isPerView(mode) && <SideFigures session={live} />}
        {live && <MovePad input={live.input} />}
        {live && <MovementStatus deck={live.movement} />}
        {live && <StageMessage session={live} />}
        {live && <Freeze session={live} />}
        {live && !sidebarOpen && <WalkVerdict session={live} onOpen={actions.sidebar} />}
      </main>
      {live && sidebarOpen && <Sidebar session={live} onClose={actions.sidebar} onReset={actions.reset} />}
      {help.value && (
        <HelpDialog
          onClose={() => {
            help.value = false;
          }}
        />
      )}
      {live && runner.value && (
        <ExperimentDialog session={live} runner={runner.value} open={experiment} locked={locked} />
      )}
    </div>
  );
}

/** As the URL asks, and remembered as what a person chooses; unless it names what there is not. */
function choose(asked: Asked, session: ViewerSession): void {
  const named = KINDS.flatMap((kind) => (asked[kind] === undefined ? [] : [{ kind, name: asked[kind] }]));
  const problem = named.map(({ kind, name }) => nameProblem(kind, name)).find((one) => one !== null);
  changeSettings({
    ...linkedSettings(asked),
    ...(problem && Object.fromEntries(named.map(({ kind }) => [kind, OFF]))),
  });
  if (problem) session.enhancement.giveUp(problem);
}
