/** The lab: everything beyond looking at the scene. Its panels are loaded when it is opened. */

import { Activity, X } from "lucide";
import type { ViewerSession } from "#viewer/session/session";
import { settings } from "../../state/app";
import { IconButton, QuietButton } from "../button";
import { lazy } from "../lazy";
import type { ViewerActions } from "./hooks";

const Panels = lazy(async () => (await import("./panels")).Panels);

interface Props {
  readonly session: ViewerSession;
  readonly actions: Pick<ViewerActions, "sidebar" | "hud" | "experiment" | "reset">;
  readonly onSkip: () => void;
}

export function Sidebar({ session, actions, onSkip }: Props) {
  return (
    <aside class="sidebar" aria-label="Lab">
      <QuietButton kind="visually-hidden" onClick={onSkip}>
        Skip to the view
      </QuietButton>
      <header class="row">
        <h2>Lab</h2>
        <QuietButton onClick={actions.experiment}>Experiment…</QuietButton>
        <IconButton
          icon={Activity}
          label="Measurements"
          shortcut="I"
          pressed={settings.value.hud}
          onClick={actions.hud}
        />
        <IconButton icon={X} label="Close lab" onClick={actions.sidebar} />
      </header>
      <Panels session={session} onReset={actions.reset} />
    </aside>
  );
}
