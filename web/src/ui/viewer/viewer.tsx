/** The viewer: the stage with its frame, what floats over it, and the sidebar. */

import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { KINDS, OFF } from "../../enhance/model/enhancer";
import { nameProblem } from "../../enhance/registry";
import { offerBridge } from "../../experiment/bridge";
import { Runner } from "../../experiment/runner";
import { PREDICTOR_NAMES } from "../../predict/registry";
import { changeSettings, settings } from "../../state/app";
import type { Asked } from "../../state/route";
import { isStreamed, MODES } from "../../state/settings";
import { ViewerSession } from "../../viewer/session";
import { ExperimentDialog } from "../experiment/experiment-dialog";
import { HelpDialog } from "./help";
import { Hud } from "./hud";
import { linkNote } from "./link-note";
import { LocalHud } from "./local-hud";
import { MovePad } from "./move-pad";
import { MovementStatus } from "./movement-status";
import { SideFigures } from "./side-figures";
import { Sidebar } from "./sidebar";
import { StageMessage } from "./stage-message";
import { Toolbar } from "./toolbar";
import { useFocusReturn } from "./use-focus-return";
import { useShortcuts } from "./use-shortcuts";
import { useWide } from "./use-wide";

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
  const canvas = useRef<HTMLCanvasElement>(null);
  const video = useRef<HTMLVideoElement>(null);
  const session = useSignal<ViewerSession | null>(null);
  const runner = useSignal<Runner | null>(null);
  const help = useSignal(false);
  const experiment = useSignal(false);
  const locked = useSignal(false);
  const wide = useWide();

  useEffect(() => {
    if (!stage.current || !canvas.current || !video.current) return undefined;
    const place = { element: stage.current, canvas: canvas.current, video: video.current };
    const current = new ViewerSession(sceneId, place, stamp);
    session.value = current;
    const movementRunner = new Runner(current);
    runner.value = movementRunner;
    const withdraw = offerBridge(movementRunner);
    stage.current.focus({ preventScroll: true });
    return () => {
      session.value = null;
      runner.value = null;
      withdraw();
      movementRunner.dispose();
      current.dispose();
    };
  }, [sceneId, stamp, session, runner]);

  const live = session.value;
  useEffect(() => {
    if (live) choose(asked, live);
  }, [asked, live]);

  const { hud, sidebar, mode } = settings.value;
  const sidebarOpen = sidebar ?? wide;
  const actions = {
    help: () => {
      help.value = !help.value;
    },
    hud: () => changeSettings({ hud: !hud }),
    sidebar: () => changeSettings({ sidebar: !sidebarOpen }),
    reset: () => session.value?.rig.resetCamera(),
    mode: () => changeSettings({ mode: MODES[(MODES.indexOf(mode) + 1) % MODES.length] ?? "stateless" }),
    experiment: () => {
      experiment.value = !experiment.value;
    },
    fullscreen: () => void toggleFullscreen(root.current),
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
          data-dash={live?.dash.value?.phase.value.kind ?? "off"}
          data-dash-frames={live?.dash.value?.stats.value.shown}
          data-local={live?.local.value?.phase.value.kind ?? "off"}
          data-local-complete={live?.local.value?.stats.value.completeMs != null}
        >
          <div class="pane">
            <canvas ref={canvas} />
          </div>
          <div class="pane">
            <video ref={video} muted playsInline disablePictureInPicture disableRemotePlayback />
          </div>
        </div>
        <Toolbar name={name} actions={actions} mode={mode} hud={hud} sidebar={sidebarOpen} />
        {live && hud && phase !== "failed" && !isStreamed(mode) && mode !== "local" && (
          <Hud session={live} wide={wide} linkNote={linkNote(asked, unknown)} />
        )}
        {live && hud && phase !== "failed" && mode === "local" && <LocalHud session={live} />}
        {live && hud && phase !== "failed" && isStreamed(mode) && <SideFigures session={live} mode={mode} />}
        {live && <MovePad input={live.input} />}
        {live && <MovementStatus deck={live.movement} />}
        {live && <StageMessage session={live} />}
      </main>
      {live && sidebarOpen && <Sidebar session={live} onClose={actions.sidebar} onReset={actions.reset} />}
      <HelpDialog open={help} />
      {live && runner.value && (
        <ExperimentDialog session={live} runner={runner.value} open={experiment} locked={locked} />
      )}
    </div>
  );
}

/** As the URL asks, and remembered as what a person chooses; unless it names what there is not. */
function choose({ reprojection, prediction: predictor, ...models }: Asked, session: ViewerSession): void {
  const named = KINDS.flatMap((kind) => (models[kind] === undefined ? [] : [{ kind, name: models[kind] }]));
  const problem = named.map(({ kind, name }) => nameProblem(kind, name)).find((one) => one !== null);
  const prediction = PREDICTOR_NAMES.find((name) => name === predictor);
  changeSettings({
    ...(problem ? Object.fromEntries(named.map(({ kind }) => [kind, OFF])) : models),
    ...((reprojection === "on" || reprojection === "off") && { reprojection: reprojection === "on" }),
    ...(prediction && { prediction }),
  });
  if (problem) session.enhancement.giveUp(problem);
}

async function toggleFullscreen(element: HTMLElement | null): Promise<void> {
  try {
    await (document.fullscreenElement ? document.exitFullscreen() : element?.requestFullscreen());
  } catch {
    // phones that have no fullscreen for pages: the frame fills the window as it is
  }
}
