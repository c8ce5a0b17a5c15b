/**
 * Bytes of a frame of each rung: the ladder's expectation, refined by measurement.
 *
 * A rung in use has the moving average of its own frames. Others are scaled like the nearest measured rung: a detailed
 * scene, or a window smaller than the rung, changes all rungs alike.
 */
import type { Rung } from "../wire/render";

/** Weight of the newest frame. */
const ALPHA = 0.3;

export class FrameSizes {
  readonly #ladder: readonly Rung[];
  readonly #seen: (number | undefined)[];

  constructor(ladder: readonly Rung[]) {
    this.#ladder = ladder;
    this.#seen = ladder.map(() => undefined);
  }

  observe(rung: number | null, bytes: number): void {
    if (rung === null || rung >= this.#seen.length || bytes <= 0) return;
    const average = this.#seen[rung];
    this.#seen[rung] = average === undefined ? bytes : average + ALPHA * (bytes - average);
  }

  expected(rung: number): number {
    return this.#seen[rung] ?? this.#ladderBytes(rung) * this.#scaleNear(rung);
  }

  /** Ratio of measured to expected bytes of the nearest measured rung. */
  #scaleNear(rung: number): number {
    for (let distance = 1; distance < this.#seen.length; distance++) {
      for (const near of [rung + distance, rung - distance]) {
        const seen = this.#seen[near];
        if (seen !== undefined) return seen / this.#ladderBytes(near);
      }
    }
    return 1;
  }

  #ladderBytes(rung: number): number {
    return (this.#ladder[rung]?.expected_kb ?? 0) * 1000;
  }
}
