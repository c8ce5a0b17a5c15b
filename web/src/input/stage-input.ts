/** Listens to keyboard, mouse, touch and wheel, and keeps what they ask for until the next animation frame samples it. */
import type { InputSample } from "../view/motion";
import { NO_NUDGE } from "../view/motion";
import { look, pinch, sum, wheel } from "./gestures";
import { Glide } from "./glide";
import { HeldKeys } from "./keys";

interface Point {
  readonly x: number;
  readonly y: number;
}

/** Where keys write text or open something. */
const TYPING = "input:not([type=radio], [type=checkbox]), select, textarea, dialog, [contenteditable]";
/** Where Space presses something, and where arrows choose something. */
const PRESSING = "button, a, summary, input";
const CHOOSING = "input[type=radio]";

export class StageInput {
  /** What the on-screen pad asks for. */
  pad: { readonly forward: number; readonly right: number; readonly up: number } = { forward: 0, right: 0, up: 0 };
  readonly #stage: HTMLElement;
  readonly #focal: () => { readonly fx: number; readonly fy: number };
  readonly #keys = new HeldKeys();
  readonly #pointers = new Map<number, Point>();
  readonly #listening = new AbortController();
  readonly #glide = new Glide();
  readonly #reducedMotion = matchMedia("(prefers-reduced-motion: reduce)");
  #nudge = NO_NUDGE;

  /** `focal` tells the focal lengths in CSS pixels of the stage. */
  constructor(stage: HTMLElement, focal: () => { readonly fx: number; readonly fy: number }) {
    this.#stage = stage;
    this.#focal = focal;
    const { signal } = this.#listening;
    addEventListener("keydown", (event) => this.#press(event), { signal });
    addEventListener("keyup", (event) => this.#keys.release(event.code), { signal });
    addEventListener("blur", () => this.#release(), { signal });
    document.addEventListener("visibilitychange", () => this.#release(), { signal });
    stage.addEventListener("pointerdown", (event) => this.#grab(event), { signal });
    stage.addEventListener("pointermove", (event) => this.#drag(event), { signal });
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"] as const) {
      stage.addEventListener(end, (event) => this.#letGo(event), { signal });
    }
    stage.addEventListener("wheel", (event) => this.#turnWheel(event), { signal, passive: false });
  }

  /** What was asked since the last sample, `elapsed` milliseconds ago. */
  sample(elapsed: number): InputSample {
    const glided = this.#glide.take(elapsed, !this.#reducedMotion.matches);
    const nudge = glided === 0 ? this.#nudge : sum(this.#nudge, { ...NO_NUDGE, forward: glided });
    this.#nudge = NO_NUDGE;
    const keys = this.#keys.axes;
    return {
      nudge,
      axes: {
        ...keys,
        forward: clamp(keys.forward + this.pad.forward),
        right: clamp(keys.right + this.pad.right),
        up: clamp(keys.up + this.pad.up),
      },
    };
  }

  dispose(): void {
    this.#listening.abort();
    this.#release();
  }

  #press(event: KeyboardEvent): void {
    const inside = (selector: string) => event.target instanceof Element && event.target.closest(selector) !== null;
    if (inside(TYPING)) return;
    if (event.code === "Space" && inside(PRESSING)) return;
    if (event.code.startsWith("Arrow") && inside(CHOOSING)) return;
    if (this.#keys.press(event)) event.preventDefault(); // the page must not scroll
  }

  #release(): void {
    this.#keys.releaseAll();
    this.#pointers.clear();
    this.#glide.stop();
    this.pad = { forward: 0, right: 0, up: 0 };
    delete this.#stage.dataset.grabbed;
  }

  #grab(event: PointerEvent): void {
    if (event.button !== 0 || this.#pointers.size >= 2) return;
    this.#stage.setPointerCapture(event.pointerId);
    this.#stage.dataset.grabbed = "";
    this.#pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  }

  #drag(event: PointerEvent): void {
    const from = this.#pointers.get(event.pointerId);
    if (from === undefined) return;
    const to = { x: event.clientX, y: event.clientY };
    this.#pointers.set(event.pointerId, to);
    const other = [...this.#pointers].find(([id]) => id !== event.pointerId)?.[1];
    const nudge = other ? pinch([from, other], [to, other], this.#stage.clientHeight) : look(from, to, this.#focal());
    this.#nudge = sum(this.#nudge, nudge);
  }

  #letGo(event: PointerEvent): void {
    this.#pointers.delete(event.pointerId);
    if (this.#pointers.size === 0) delete this.#stage.dataset.grabbed;
  }

  #turnWheel(event: WheelEvent): void {
    if (event.ctrlKey) return; // the browser's zoom
    event.preventDefault();
    this.#glide.add(wheel(event));
  }
}

function clamp(axis: number): number {
  return Math.max(-1, Math.min(1, axis));
}
