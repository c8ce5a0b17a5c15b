/** Toolbar at the top of the stage: back button, scene name and switches. */

import { Activity, ArrowLeft, Camera, CircleHelp, Columns2, FlaskConical, Maximize, SlidersHorizontal } from "lucide";
import { titleOf } from "#viewer/sources/sides";
import { DEFAULT_SETTINGS, type Mode } from "#viewer/state/settings";
import { Icon } from "../icon";
import { IconButton } from "../icon-button";
import type { ViewerActions } from "./use-shortcuts";

interface Props {
  readonly name: string;
  /** There is a scene to look at. */
  readonly usable: boolean;
  readonly actions: ViewerActions;
  readonly mode: Mode;
  readonly hud: boolean;
  readonly sidebar: boolean;
  /** A picture is being saved. */
  readonly saving: boolean;
}

export function Toolbar({ name, usable, actions, mode, hud, sidebar, saving }: Props) {
  return (
    <header class="toolbar">
      <div class="floating title">
        <a class="icon-button" href="#/" aria-label="Back to all scenes" title="Back to all scenes">
          <Icon of={ArrowLeft} />
        </a>
        <h1>{name}</h1>
      </div>
      {usable && (
        <div class="floating" role="toolbar" aria-label="View">
          <IconButton icon={CircleHelp} label="Help" shortcut="H" onClick={actions.help} />
          <IconButton
            icon={Columns2}
            label={`Mode: ${titleOf(mode)}`}
            shortcut="M"
            pressed={mode !== DEFAULT_SETTINGS.mode}
            onClick={actions.mode}
          />
          <IconButton icon={Activity} label="Measurements" shortcut="I" pressed={hud} onClick={actions.hud} />
          <IconButton icon={FlaskConical} label="Experiment" shortcut="X" onClick={actions.experiment} />
          <IconButton icon={Camera} label="Save a picture" shortcut="T" busy={saving} onClick={actions.screenshot} />
          {actions.fullscreen && (
            <IconButton icon={Maximize} label="Fullscreen" shortcut="F" onClick={actions.fullscreen} />
          )}
          <IconButton
            icon={SlidersHorizontal}
            label="Settings"
            shortcut="P"
            pressed={sidebar}
            onClick={actions.sidebar}
          />
        </div>
      )}
    </header>
  );
}
