/** Buttons of an embedded viewer: back to the start view, and fullscreen. */
import { createElement, type IconNode, Maximize, RotateCcw } from "lucide";

interface Actions {
  readonly reset: () => void;
  readonly fullscreen: () => void;
}

export function toolbar({ reset, fullscreen }: Actions): HTMLElement {
  const bar = document.createElement("div");
  bar.className = "toolbar";
  bar.setAttribute("role", "toolbar");
  bar.setAttribute("aria-label", "View");
  bar.append(button("Back to the start", RotateCcw, reset));
  if (document.fullscreenEnabled) bar.append(button("Fullscreen", Maximize, fullscreen));
  return bar;
}

function button(label: string, icon: IconNode, press: () => void): HTMLButtonElement {
  const button = document.createElement("button");
  button.type = "button";
  button.title = label;
  button.setAttribute("aria-label", label);
  button.append(createElement(icon, { width: 18, height: 18, "aria-hidden": "true" }));
  button.addEventListener("click", press);
  return button;
}
