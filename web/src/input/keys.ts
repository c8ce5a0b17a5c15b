/** Which movement keys are held. Keys are known by their place (`event.code`), so that every layout works. */
import type { Axes } from "../view/motion";

type Axis = Exclude<keyof Axes, "haste">;

/** How many times as fast as usual one walks while the key is held. */
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

/** The part of a KeyboardEvent that matters. */
export interface Key {
  readonly code: string;
  readonly ctrlKey: boolean;
  readonly altKey: boolean;
  readonly metaKey: boolean;
}

export class HeldKeys {
  readonly #held = new Set<string>();

  /** Returns whether the key moves the camera. Shortcuts of the browser or the system are none of ours. */
  press({ code, ctrlKey, altKey, metaKey }: Key): boolean {
    if (!(code in BINDINGS || code in HASTE) || ctrlKey || altKey || metaKey) return false;
    this.#held.add(code);
    return true;
  }

  release(code: string): void {
    this.#held.delete(code);
  }

  /** The page lost the focus: nothing tells it any more when keys go up. */
  releaseAll(): void {
    this.#held.clear();
  }

  get axes(): Axes {
    const axes = { forward: 0, right: 0, up: 0, turnRight: 0, turnUp: 0 };
    for (const code of this.#held) {
      const [axis, sign] = BINDINGS[code] ?? [];
      if (axis !== undefined && sign !== undefined) axes[axis] = Math.max(-1, Math.min(1, axes[axis] + sign));
    }
    const haste = [...this.#held].reduce((product, code) => product * (HASTE[code] ?? 1), 1);
    return haste === 1 ? axes : { ...axes, haste };
  }
}
