/** The toolbar over the stage: back, the scene's name, and a visitor's tools. */

import { ArrowLeft, Camera, Check, CircleHelp, FlaskConical, Link2, Maximize, SlidersHorizontal } from "lucide";
import { useState } from "preact/hooks";
import type { ViewerSession } from "#viewer/session/session";
import { showAddress } from "../../state/address";
import { Icon, IconButton } from "../button";
import { lazy } from "../lazy";
import type { ViewerActions } from "./hooks";

const ViewMenu = lazy(async () => (await import("./view-menu")).ViewMenu);

/** Duration of the confirmation, in milliseconds. */
const SAID = 2000;

interface Props {
  readonly name: string;
  /** Null while there is no scene to look at. */
  readonly session: ViewerSession | null;
  readonly actions: ViewerActions;
  readonly lab: boolean;
  readonly saving: boolean;
}

export function Toolbar({ name, session, actions, lab, saving }: Props) {
  const [menu, setMenu] = useState(false);
  return (
    <header class="toolbar row spread">
      <div class="floating title row">
        <a class="icon-button" href="#/" aria-label="Back to all scenes" title="Back to all scenes">
          <Icon of={ArrowLeft} />
        </a>
        <h1>{name}</h1>
      </div>
      {session && (
        <fieldset class="floating row" aria-label="Tools">
          <IconButton
            icon={SlidersHorizontal}
            label="View"
            title="Picture, quality, dragging and theme"
            worded
            aria-expanded={menu}
            aria-controls="view-menu"
            onClick={() => setMenu(!menu)}
          />
          <CopyLink session={session} />
          <IconButton icon={CircleHelp} label="Help" shortcut="H" onClick={actions.help} />
          <IconButton icon={Camera} label="Save a picture" shortcut="T" busy={saving} onClick={actions.screenshot} />
          {actions.fullscreen && (
            <IconButton icon={Maximize} label="Fullscreen" shortcut="F" onClick={actions.fullscreen} />
          )}
          <IconButton icon={FlaskConical} label="Lab" shortcut="P" worded pressed={lab} onClick={actions.sidebar} />
        </fieldset>
      )}
      {session && menu && <ViewMenu session={session} onReset={actions.reset} onClose={() => setMenu(false)} />}
    </header>
  );
}

/** Copies a link to the current view to the clipboard and the address bar. */
function CopyLink({ session }: { session: ViewerSession }) {
  const [copied, setCopied] = useState(false);
  const copy = async () => {
    showAddress(session);
    try {
      await navigator.clipboard.writeText(location.href);
      setCopied(true);
      setTimeout(() => setCopied(false), SAID);
    } catch {
      prompt("Link to this view:", location.href); // no clipboard without HTTPS
    }
  };
  return (
    <IconButton
      icon={copied ? Check : Link2}
      label={copied ? "Link copied" : "Copy a link to this view"}
      onClick={() => void copy()}
    />
  );
}
