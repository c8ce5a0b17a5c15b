/** The toolbar over the stage: back, the scene's name, and what a visitor needs. */

import { useSignal } from "@preact/signals";
import { ArrowLeft, Camera, CircleHelp, FlaskConical, Maximize, SlidersHorizontal } from "lucide";
import { useCallback } from "preact/hooks";
import type { ViewerSession } from "#viewer/session/session";
import { Icon } from "../icon";
import { IconButton } from "../icon-button";
import { lazy } from "../lazy";
import { CopyLink } from "./copy-link";
import type { ViewerActions } from "./use-shortcuts";

const ViewMenu = lazy(async () => (await import("./view-menu")).ViewMenu);

interface Props {
  readonly name: string;
  /** Null while there is no scene to look at. */
  readonly session: ViewerSession | null;
  readonly actions: ViewerActions;
  /** The lab is open. */
  readonly lab: boolean;
  /** A picture is being saved. */
  readonly saving: boolean;
}

export function Toolbar({ name, session, actions, lab, saving }: Props) {
  const menu = useSignal(false);
  const close = useCallback(() => {
    menu.value = false;
  }, [menu]);
  return (
    <header class="toolbar">
      <div class="floating title">
        <a class="icon-button" href="#/" aria-label="Back to all scenes" title="Back to all scenes">
          <Icon of={ArrowLeft} />
        </a>
        <h1>{name}</h1>
      </div>
      {session && (
        <div class="floating" role="toolbar" aria-label="Tools">
          <button
            type="button"
            class="icon-button worded"
            aria-label="View"
            title="Picture, quality, dragging and theme"
            aria-expanded={menu.value}
            aria-controls="view-menu"
            onClick={() => {
              menu.value = !menu.value;
            }}
          >
            <Icon of={SlidersHorizontal} />
            <span>View</span>
          </button>
          <CopyLink session={session} />
          <IconButton icon={CircleHelp} label="Help" shortcut="H" onClick={actions.help} />
          <IconButton icon={Camera} label="Save a picture" shortcut="T" busy={saving} onClick={actions.screenshot} />
          {actions.fullscreen && (
            <IconButton icon={Maximize} label="Fullscreen" shortcut="F" onClick={actions.fullscreen} />
          )}
          <IconButton icon={FlaskConical} label="Lab" shortcut="P" worded pressed={lab} onClick={actions.sidebar} />
        </div>
      )}
      {session && menu.value && <ViewMenu session={session} onReset={actions.reset} onClose={close} />}
    </header>
  );
}
