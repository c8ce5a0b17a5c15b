/** Figures of the last minute for each picture on the stage and, with two of them, scores of the last walk. */
import { type ReadonlySignal, signal } from "@preact/signals";
import type { ServerConfig } from "#client/wire/render";
import { ComparisonHistory } from "../charts/history";
import { WalkRecorder } from "../charts/walk";
import { groundTruth, psnrOf } from "../quality/ground-truth";
import { WalkQuality } from "../quality/walk-quality";
import { type Figures, STATS_EVERY } from "../view/meter";
import type { Presence } from "../view/presence";
import type { Rig } from "../view/rig";
import type { Side } from "./side";

/** Quality of the last walk against ground truth. */
export interface SeenQuality {
  /** Mean PSNR of each side, from left to right, in dB; empty while unknown. */
  readonly psnr: readonly number[];
  /** Number of pictures in the means. */
  readonly moments: number;
  /** Reason for missing scores, in one sentence; null while scoring, and with scores. */
  readonly problem: string | null;
}

export const UNSCORED: SeenQuality = { psnr: [], moments: 0, problem: null };

/** The part of a `Side` that is used. */
export interface ComparedSide extends Pick<Side, "onPresented" | "picture"> {
  readonly figures: Figures | null;
}

export class Comparison {
  /** From left to right. */
  readonly sides: readonly ComparedSide[];
  readonly history: ComparisonHistory;
  readonly walks = new WalkRecorder();
  /** Quality of the last walk. */
  readonly quality = signal(UNSCORED);
  readonly #rig: Rig;
  readonly #seen: WalkQuality;
  /** The walk that was scored last, or is being scored. */
  #scored: unknown = null;
  #scoring = new AbortController();
  readonly #stops: readonly (() => void)[];

  constructor(
    rig: Rig,
    sides: readonly ComparedSide[],
    presence: Pick<Presence, "every">,
    config: ReadonlySignal<ServerConfig | null>,
  ) {
    this.#rig = rig;
    this.sides = sides;
    this.history = new ComparisonHistory(sides.length);
    this.#seen = new WalkQuality({
      truth: (pose, signal) => {
        const lens = { ...rig.intrinsics.peek(), ...rig.viewport.peek() };
        return groundTruth({ server: config.peek(), scene: rig.scene?.id ?? "", lens }, pose, signal);
      },
      compare: psnrOf,
    });
    this.#stops = [
      presence.every(STATS_EVERY, () => this.#look(performance.now())),
      rig.onSample(({ seq }, at) => this.walks.sampled(seq, at)),
      ...sides.map((side, i) =>
        side.onPresented((frame) => {
          this.history.presented(i, frame);
          this.walks.presented(i, frame);
        }),
      ),
    ];
  }

  resumed(): void {
    this.walks.resumed();
    this.#seen.forget();
  }

  dispose(): void {
    for (const stop of this.#stops) stop();
    this.#scoring.abort();
    this.#seen.forget();
  }

  #look(now: number): void {
    const figures = this.sides.map((side) => side.figures);
    this.history.sample(figures, now);
    this.walks.sample(figures, now);
    if (this.sides.length > 1) this.#judge(now);
  }

  /** Records the pictures of each walk and has them scored between its end and the start of the next one. */
  #judge(now: number): void {
    const { walks } = this;
    if (walks.walking) {
      this.#scoring.abort();
      if (now - walks.movedAt >= STATS_EVERY) return;
      this.#seen.walked(this.#rig.pose, () => this.sides.map((side) => side.picture()), now);
    } else if (walks.last.peek() === this.#scored) {
      this.#seen.forget(); // it was too short
    } else {
      this.#scored = walks.last.peek();
      this.#scoring = new AbortController();
      void this.#score(this.#scoring.signal);
    }
  }

  async #score(signal: AbortSignal): Promise<void> {
    this.quality.value = UNSCORED;
    try {
      for await (const score of this.#seen.scores(signal)) {
        if (!signal.aborted) this.quality.value = { ...score, problem: null };
      }
    } catch (error) {
      if (signal.aborted) return;
      this.quality.value = {
        ...UNSCORED,
        problem: error instanceof Error ? error.message : "There is no ground truth.",
      };
    }
  }
}
