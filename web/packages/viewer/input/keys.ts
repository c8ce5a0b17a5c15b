/** The movement keys that are held. Keys are identified by their position (`event.code`), which works on every layout. */
import type { Axes } from "../view/motion";

type Axis = Exclude<keyof Axes, "haste">;

/**
 * Milliseconds that Shift is held alone before the camera sinks: it is also half of "?", Shift+Tab and screenshot
 * shortcuts.
 */
const SHIFT_ALONE = 200;

/** Factors of the walking speed while these keys are held. */
const HASTE: Readonly<Record<string, number>> = { KeyC: 4, KeyZ: 1 / 4 };

const BINDINGS: Readonly<Record<string, readonly [Axis, 1 | -1]>> = {
  KeyW: ["forward", 1],
  KeyS: ["forward", -1],
  KeyD: ["right", 1],
  KeyA: ["right", -1],
  Space: ["up", 1],
  KeyE: ["up", 1],
  KeyQ: ["up", -1],
  ShiftLeft: ["up", -1],
  ShiftRight: ["up", -1],
  ArrowRight: ["turnRight", 1],
  ArrowLeft: ["turnRight", -1],
  ArrowUp: ["turnUp", 1],
  ArrowDown: ["turnUp", -1],
};

/** The part of a KeyboardEvent that is used. */
export interface Key {
  readonly code: string;
  readonly ctrlKey: boolean;
  readonly altKey: boolean;
  readonly metaKey: boolean;
}

export class HeldKeys {
  /** Milliseconds for which each key has been held. */
  readonly #held = new Map<string, number>();

  /** Returns whether the key moves the camera. Shortcuts of the browser and the system are left alone. */
  press({ code, ctrlKey, altKey, metaKey }: Key): boolean {
    if (isMeta(code)) this.releaseAll();
    if (!(code in BINDINGS || code in HASTE) || ctrlKey || altKey || metaKey) {
      if (!isShift(code)) for (const held of this.#held.keys()) if (isShift(held)) this.#held.delete(held);
      return false;
    }
    if (!this.#held.has(code)) this.#held.set(code, 0);
    return true;
  }

  /** macOS reports no keyup for keys that are released while Cmd is held, so Cmd releases them all. */
  release(code: string): void {
    if (isMeta(code)) this.releaseAll();
    else this.#held.delete(code);
  }

  /** Releases all keys, since a page without the focus gets no keyup events. */
  releaseAll(): void {
    this.#held.clear();
  }

  /** Input from the held keys, `elapsed` milliseconds after the last call. */
  axes(elapsed: number): Axes {
    const axes = { forward: 0, right: 0, up: 0, turnRight: 0, turnUp: 0 };
    for (const [code, before] of this.#held) {
      this.#held.set(code, before + elapsed);
      const [axis, sign] = BINDINGS[code] ?? [];
      if (axis === undefined || sign === undefined || (isShift(code) && before + elapsed < SHIFT_ALONE)) continue;
      axes[axis] = Math.max(-1, Math.min(1, axes[axis] + sign));
    }
    const haste = [...this.#held.keys()].reduce((product, code) => product * (HASTE[code] ?? 1), 1);
    return haste === 1 ? axes : { ...axes, haste };
  }
}

function isShift(code: string): boolean {
  return code === "ShiftLeft" || code === "ShiftRight";
}

function isMeta(code: string): boolean {
  return code === "MetaLeft" || code === "MetaRight";
}
