/** The stage of a viewer in any element of a page, with its styles. */
import type { Stage } from "../session/session";
import styles from "./stage.css?inline";

/** A shadow root with these style sheets, in a form that no content security policy forbids. */
export function shadowOf(host: HTMLElement, ...sheets: readonly string[]): ShadowRoot {
  const root = host.attachShadow({ mode: "open" });
  root.adoptedStyleSheets = sheets.map((text) => {
    const sheet = new CSSStyleSheet();
    sheet.replaceSync(text);
    return sheet;
  });
  return root;
}

const HOST = ":host { display: block; position: relative; width: 100%; height: 100%; overflow: hidden; }";

/** Fills a container with a stage; `label` is its name for assistive technology. */
export function openStage(container: HTMLElement, label: string): Stage & { readonly close: () => void } {
  const page = container.ownerDocument;
  const host = page.createElement("div");
  const [element, left, right] = ["stage", "pane", "pane"].map((name) => {
    const div = page.createElement("div");
    div.className = name;
    return div;
  }) as [HTMLDivElement, HTMLDivElement, HTMLDivElement];
  element.tabIndex = 0;
  element.setAttribute("role", "application");
  element.setAttribute("aria-label", label);
  element.append(left, right);
  shadowOf(host, HOST, styles).append(element);
  container.append(host);
  return { element, left, right, sharesPage: true, close: () => host.remove() };
}
