/** Switches between the system's theme, light and dark. */

import { Monitor, Moon, Sun } from "lucide";
import type { Settings } from "#viewer/state/settings";
import { changeSettings, settings } from "../state/app";
import { IconButton } from "./button";

const NEXT: Record<Settings["theme"], Settings["theme"]> = { system: "light", light: "dark", dark: "system" };
const ICONS = { system: Monitor, light: Sun, dark: Moon };
const NAMES = { system: "as the system", light: "light", dark: "dark" };

export function ThemeButton() {
  const { theme } = settings.value;
  return (
    <IconButton
      icon={ICONS[theme]}
      label={`Theme: ${NAMES[theme]}`}
      onClick={() => changeSettings({ theme: NEXT[theme] })}
    />
  );
}
