/** The head of every page but the viewer: where it all begins, links to other pages, and the theme. */
import type { ComponentChildren } from "preact";
import { ThemeButton } from "./theme-button";

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
