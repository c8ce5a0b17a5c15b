/** The header of every page but the viewer: link to the scenes, links to other pages, and the theme. */
import { Monitor, Moon, Sun } from "lucide";
import type { ComponentChildren } from "preact";
import type { Settings } from "#viewer/state/settings";
import { changeSettings, settings } from "../state/app";
import { IconButton } from "./button";

const NEXT: Record<Settings["theme"], Settings["theme"]> = { system: "light", light: "dark", dark: "system" };
const ICONS = { system: Monitor, light: Sun, dark: Moon };
const NAMES = { system: "system", light: "light", dark: "dark" };

export function TopBar({ children }: { children: ComponentChildren }) {
  return (
    <header class="top-bar row spread">
      <a class="brand row" href="#/">
        <img src="icon.svg" alt="" width="26" height="26" />
        TIGAS
      </a>
      <div class="row">
        {children}
        <ThemeButton />
      </div>
    </header>
  );
}

/** Switches between the system's theme, light and dark. */
function ThemeButton() {
  const { theme } = settings.value;
  return (
    <IconButton
      icon={ICONS[theme]}
      label={`Theme: ${NAMES[theme]}`}
      onClick={() => changeSettings({ theme: NEXT[theme] })}
    />
  );
}
