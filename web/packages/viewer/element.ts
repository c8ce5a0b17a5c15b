/**
 * The element `<tigas-viewer src="https://viewer.example" scene="garden">`. It can be imported where there is no document,
 * as on a server that renders pages.
 */
import { effect } from "@preact/signals";
import { createElement, type IconNode, Maximize, RotateCcw } from "lucide";
import { createViewer, type Viewer, type ViewerEvents } from "./create-viewer";
import {
  type Attributes,
  attributeMode,
  attributePose,
  attributeQuality,
  posterUrl,
  serverUrl,
} from "./embed/attributes";
import styles from "./embed/element.css?inline";
import { shadowOf } from "./embed/stage";

const TAG = "tigas-viewer";
const EVENTS = ["loaded", "frame", "stats", "error"] as const;
/** Base class, with a stand-in where there are no elements. */
const Base = (globalThis.HTMLElement ?? class {}) as typeof HTMLElement;

interface Parts {
  readonly view: HTMLElement;
  readonly poster: HTMLImageElement;
  readonly message: HTMLElement;
  readonly toolbar: HTMLElement;
}

/** Attributes that a viewer follows, with functions that read one, throwing if it is invalid, and apply it. */
const APPLIED: Readonly<Record<string, (of: Attributes) => (viewer: Viewer) => void>> = {
  mode: (of) => {
    const settings = attributeMode(of);
    return (viewer) => viewer.set(settings);
  },
  quality: (of) => {
    const settings = attributeQuality(of);
    return (viewer) => viewer.set(settings);
  },
  at: (of) => {
    const pose = attributePose(of);
    return (viewer) => {
      if (pose) viewer.camera = pose;
    };
  },
};

export class TigasViewer extends Base {
  static readonly observedAttributes = ["src", "scene", "mode", "quality", "at", "controls", "poster"];
  #parts: Parts | undefined;
  #viewer: Viewer | null = null;
  #stopSaying = () => {};
  #reopening = false;
  #messages = { invalid: "", problem: "" };

  /** Controls the view by code; null while the element is not in a document or names no scene. */
  get viewer(): Viewer | null {
    return this.#viewer;
  }

  connectedCallback(): void {
    this.#parts ??= this.#build();
    this.#open(this.#parts);
  }

  disconnectedCallback(): void {
    this.#close();
  }

  attributeChangedCallback(name: string, before: string | null, now: string | null): void {
    const parts = this.#parts;
    if (before === now || parts === undefined || !this.isConnected) return;
    if (name === "src" || name === "scene") this.#reopen(parts);
    else if (name === "controls") parts.toolbar.hidden = now === null;
    else if (name === "poster") parts.poster.src = posterUrl(this.#attribute);
    else if (this.#viewer) this.#apply(this.#viewer, name);
  }

  readonly #attribute = (name: string) => this.getAttribute(name);

  #build(): Parts {
    const [view, poster, message] = [part("div", "view"), part("img", "poster"), part("p", "message")];
    Object.assign(poster, { alt: "", crossOrigin: "anonymous" });
    message.setAttribute("role", "status");
    const buttons = toolbar(
      () => this.#viewer?.reset(),
      () => void toggleFullscreen(this).catch(() => undefined), // the browser refuses it
    );
    shadowOf(this, styles).append(view, poster, message, buttons);
    return { view, poster, message, toolbar: buttons };
  }

  #open(parts: Parts): void {
    const scene = this.getAttribute("scene");
    parts.toolbar.hidden = !this.hasAttribute("controls");
    parts.poster.hidden = scene === null;
    this.#say({ invalid: "", problem: "" });
    if (scene === null) return;
    parts.poster.src = posterUrl(this.#attribute);
    const viewer = this.#create(parts.view, scene);
    if (viewer === null) return;
    this.#viewer = viewer;
    viewer.on("frame", () => {
      parts.poster.hidden = true;
    });
    for (const name of EVENTS) viewer.on(name, (event) => this.#tell(name, event));
    this.#stopSaying = effect(() => this.#say({ problem: viewer.problem.value?.message ?? "" }));
    this.#apply(viewer);
  }

  /** Creates a viewer of the scene; null if `src` is invalid. */
  #create(view: HTMLElement, scene: string): Viewer | null {
    const label = this.getAttribute("aria-label") ?? scene;
    try {
      return createViewer(view, { scene, server: serverUrl(this.#attribute), label });
    } catch (error) {
      this.#refuse(error);
      return null;
    }
  }

  #close(): void {
    this.#stopSaying();
    this.#viewer?.destroy();
    this.#viewer = null;
  }

  /** Opens another scene or server once all attributes are set. */
  #reopen(parts: Parts): void {
    if (this.#reopening) return;
    this.#reopening = true;
    queueMicrotask(() => {
      this.#reopening = false;
      this.#close();
      if (this.isConnected) this.#open(parts);
    });
  }

  /** Applies the attributes `mode`, `quality` and `at`, or only the changed one, and reports any that are invalid. */
  #apply(viewer: Viewer, changed?: string): void {
    let invalid: unknown = null;
    for (const [name, read] of Object.entries(APPLIED)) {
      try {
        const apply = read(this.#attribute);
        if (changed === undefined || changed === name) apply(viewer);
      } catch (error) {
        invalid ??= error;
      }
    }
    if (invalid === null) this.#say({ invalid: "" });
    else this.#refuse(invalid);
  }

  /** Reports an invalid attribute. */
  #refuse(error: unknown): void {
    const message = error instanceof Error ? error.message : String(error);
    this.#say({ invalid: message });
    this.#tell("error", { code: "invalid", message });
  }

  /** Shows why there is no picture, or which attribute is wrong; an omitted message is kept. */
  #say(messages: { readonly invalid?: string; readonly problem?: string }): void {
    this.#messages = { ...this.#messages, ...messages };
    const text = this.#messages.invalid || this.#messages.problem;
    if (this.#parts) Object.assign(this.#parts.message, { textContent: text, hidden: text === "" });
  }

  #tell<Name extends keyof ViewerEvents>(name: Name, detail: ViewerEvents[Name]): void {
    this.dispatchEvent(new CustomEvent(name, { detail }));
  }
}

function part<Tag extends keyof HTMLElementTagNameMap>(tag: Tag, className: string): HTMLElementTagNameMap[Tag] {
  return Object.assign(document.createElement(tag), { className });
}

/** Buttons: back to the start view, and fullscreen. */
function toolbar(reset: () => void, fullscreen: () => void): HTMLElement {
  const bar = document.createElement("div");
  bar.className = "toolbar";
  bar.setAttribute("role", "group");
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

async function toggleFullscreen(element: HTMLElement): Promise<void> {
  const { fullscreenElement } = element.getRootNode() as Document | ShadowRoot;
  await (fullscreenElement === element ? document.exitFullscreen() : element.requestFullscreen());
}

declare global {
  interface HTMLElementTagNameMap {
    [TAG]: TigasViewer;
  }
}

if (globalThis.customElements && !customElements.get(TAG)) customElements.define(TAG, TigasViewer);
