/** Shadow roots of embedded viewers: styles of the page and of the viewer do not reach each other. */

/** A shadow root with these style sheets, which no content security policy forbids. */
export function shadowOf(host: HTMLElement, ...sheets: readonly string[]): ShadowRoot {
  const root = host.attachShadow({ mode: "open" });
  root.adoptedStyleSheets = sheets.map((text) => {
    const sheet = new CSSStyleSheet();
    sheet.replaceSync(text);
    return sheet;
  });
  return root;
}
