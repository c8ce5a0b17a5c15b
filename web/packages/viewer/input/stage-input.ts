/** Input from keyboard, mouse, touch, wheel and gamepad, collected until the next animation frame samples it. */
import { type InputSample, NO_NUDGE, type Nudge } from "../view/motion";
import { gamepadAxes } from "./gamepad";
import { look, orbit, pan, pinch, sum, wheel } from "./gestures";
import { Glide } from "./glide";
import { HeldKeys } from "./keys";

interface Point {
  readonly x: number;
  readonly y: number;
}

/** Elements in which keys write text or open something. */
export const TYPING = "input:not([type=radio], [type=checkbox]), select, textarea, dialog, [contenteditable]";
/** Elements in which Space activates and Shift+Tab goes back, and elements in which arrows choose. */
const PRESSING = "button, a, summary, input";
const CHOOSING = "input[type=radio]";

export interface StageInputOptions {
  /** The focal lengths in CSS pixels of the stage. */
  readonly focal: () => { readonly fx: number; readonly fy: number };
  /** Whether dragging orbits; holding Alt does the opposite. */
  readonly orbits: () => boolean;
  /** Whether keys move the camera wherever the focus is, or only on the stage. */
  readonly keysAnywhere: () => boolean;
  /** Called when the stage is double-clicked. */
  readonly onFocus: (event: MouseEvent) => void;
  /** Whether keys, gamepads and the wheel move the camera only while the stage has the focus. */
  readonly sharesPage: boolean;
}

const [MAIN, MIDDLE, RIGHT] = [0, 1, 2];

export class StageInput {
  /** Input of the on-screen pad. */
  pad: { readonly forward: number; readonly right: number; readonly up: number } = { forward: 0, right: 0, up: 0 };
  readonly #stage: HTMLElement;
  readonly #options: StageInputOptions;
  readonly #keys = new HeldKeys();
  readonly #pointers = new Map<number, Point>();
  /** The button that was pressed first. */
  #button = MAIN;
  readonly #listening = new AbortController();
  readonly #glide = new Glide(() => !matchMedia("(prefers-reduced-motion: reduce)").matches);
  /** Whether any gamepad was seen: polling them takes longer than all other input. */
  #gamepads = navigator.getGamepads?.().some(Boolean);
  #nudge = NO_NUDGE;

  constructor(stage: HTMLElement, options: StageInputOptions) {
    this.#stage = stage;
    this.#options = options;
    const { signal } = this.#listening;
    const keyboard: EventTarget = options.sharesPage ? stage : window;
    keyboard.addEventListener("keydown", (event) => this.#press(event as KeyboardEvent), { signal });
    addEventListener("gamepadconnected", () => (this.#gamepads = true), { signal });
    addEventListener("keyup", (event) => this.#keys.release(event.code), { signal });
    addEventListener("blur", () => this.#release(), { signal });
    document.addEventListener("visibilitychange", () => this.#release(), { signal });
    stage.addEventListener("pointerdown", (event) => this.#grab(event), { signal });
    stage.addEventListener("pointermove", (event) => this.#drag(event), { signal });
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"] as const) {
      stage.addEventListener(end, (event) => this.#letGo(event), { signal });
    }
    stage.addEventListener("dblclick", options.onFocus, { signal });
    stage.addEventListener("contextmenu", (event) => event.preventDefault(), { signal }); // its button drags
    stage.addEventListener("wheel", (event) => this.#turnWheel(event), { signal, passive: false });
    if (options.sharesPage) stage.addEventListener("blur", () => this.#keys.releaseAll(), { signal });
  }

  /** Input since the last sample, `elapsed` milliseconds ago. */
  sample(elapsed: number): InputSample {
    const glided = this.#glide.take(elapsed);
    const nudge = glided === 0 ? this.#nudge : sum(this.#nudge, { ...NO_NUDGE, forward: glided });
    this.#nudge = NO_NUDGE;
    const keys = this.#keys.axes(elapsed);
    const gamepad = this.#gamepads && this.#attended ? gamepadAxes(navigator.getGamepads()) : null;
    const haste = (keys.haste ?? 1) * (gamepad?.haste ?? 1);
    return {
      nudge,
      axes: {
        forward: clamp(keys.forward + this.pad.forward + (gamepad?.forward ?? 0)),
        right: clamp(keys.right + this.pad.right + (gamepad?.right ?? 0)),
        up: clamp(keys.up + this.pad.up + (gamepad?.up ?? 0)),
        turnRight: clamp(keys.turnRight + (gamepad?.turnRight ?? 0)),
        turnUp: clamp(keys.turnUp + (gamepad?.turnUp ?? 0)),
        ...(haste !== 1 && { haste }),
      },
    };
  }

  /** Turns mouse look on or off; Esc also ends it. */
  async lock(): Promise<void> {
    if (this.#locked) {
      document.exitPointerLock();
      return;
    }
    try {
      await this.#stage.requestPointerLock?.();
    } catch {
      // browsers refuse it for about a second after Esc
    }
  }

  dispose(): void {
    this.#listening.abort();
    this.#release();
  }

  #press(event: KeyboardEvent): void {
    const inside = (selector: string) => event.target instanceof Element && event.target.closest(selector) !== null;
    if (inside(TYPING) || !(this.#options.keysAnywhere() || this.#stage.contains(event.target as Node | null))) return;
    if (event.code === "Tab") this.#keys.releaseAll(); // the focus moves on
    if (["Space", "ShiftLeft", "ShiftRight"].includes(event.code) && inside(PRESSING)) return;
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
    if (![MAIN, MIDDLE, RIGHT].includes(event.button) || this.#pointers.size >= 2 || this.#locked) return;
    if (this.#pointers.size === 0) this.#button = event.button;
    if (event.button === MIDDLE) event.preventDefault(); // it would scroll
    this.#stage.setPointerCapture(event.pointerId);
    this.#stage.dataset.grabbed = "";
    this.#pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  }

  #drag(event: PointerEvent): void {
    if (this.#locked) {
      const moved = { x: event.movementX, y: event.movementY };
      this.#nudge = sum(this.#nudge, look(moved, { x: 0, y: 0 }, this.#options.focal()));
      return;
    }
    const from = this.#pointers.get(event.pointerId);
    if (from === undefined) return;
    const to = { x: event.clientX, y: event.clientY };
    this.#pointers.set(event.pointerId, to);
    const other = [...this.#pointers].find(([id]) => id !== event.pointerId)?.[1];
    const nudge = other ? pinch([from, other], [to, other], this.#stage.clientHeight) : this.#dragged(from, to, event);
    this.#nudge = sum(this.#nudge, nudge);
  }

  #dragged(from: Point, to: Point, { altKey }: PointerEvent): Nudge {
    const { clientWidth, clientHeight } = this.#stage;
    if (this.#button !== MAIN) return pan(from, to, clientHeight);
    return this.#options.orbits() === altKey ? look(from, to, this.#options.focal()) : orbit(from, to, clientWidth);
  }

  get #locked(): boolean {
    return document.pointerLockElement === this.#stage;
  }

  /** Whether input without a target element is meant for this stage. */
  get #attended(): boolean {
    if (!this.#options.sharesPage) return true;
    return (this.#stage.getRootNode() as Document | ShadowRoot).activeElement === this.#stage;
  }

  #letGo(event: PointerEvent): void {
    this.#pointers.delete(event.pointerId);
    if (this.#pointers.size === 0) delete this.#stage.dataset.grabbed;
  }

  #turnWheel(event: WheelEvent): void {
    if (!this.#attended) return; // the page scrolls
    event.preventDefault(); // with Ctrl, which is also how browsers report a pinch on a trackpad, the page would zoom
    this.#glide.add(wheel(event));
  }
}

function clamp(axis: number): number {
  return Math.max(-1, Math.min(1, axis));
}
