/**
 * Quality of the pictures shown during a walk: pictures of all sides are kept at intervals while the camera moves. When
 * it stands still, each is compared with the view from the viewer's pose at that moment. No ground truth is requested
 * during the walk, so that it does not compete for link and renderer; one ground truth serves all sides.
 */
import type { ScenePose } from "../view/camera";

/** Maximum number of moments kept, evenly spread over the walk, so that ground truth is soon complete. */
const MOST = 6;
/** Interval of the first moments in milliseconds; it grows in long walks. */
const EVERY = 500;

/** A kept picture, closed once it has been scored. */
export type Picture = ImageBitmap;

export interface WalkQualityOptions {
  /** Gets the lossless view from a pose. */
  readonly truth: (pose: ScenePose, signal: AbortSignal) => Promise<Picture>;
  /** PSNR of each picture against the truth, in dB; null is an empty picture, which counts as black. */
  readonly compare: (pictures: readonly (Picture | null)[], truth: Picture) => readonly number[];
}

interface Moment {
  readonly pose: ScenePose;
  readonly pictures: readonly Promise<Picture | null>[];
}

export class WalkQuality {
  readonly #options: WalkQualityOptions;
  #moments: Moment[] = [];
  #every = EVERY;
  #keptAt = Number.NEGATIVE_INFINITY;

  constructor(options: WalkQualityOptions) {
    this.#options = options;
  }

  /** Records the camera at `pose` during a walk: keeps the picture of each side at intervals; `now` in milliseconds. */
  walked(pose: ScenePose, pictures: () => readonly (Promise<Picture> | null)[], now: number): void {
    if (now - this.#keptAt < this.#every) return;
    this.#keptAt = now;
    const kept = pictures().map(async (picture) => (await picture?.catch(() => null)) ?? null);
    this.#moments.push({ pose, pictures: kept });
    if (this.#moments.length <= MOST) return;
    this.#drop(this.#moments.filter((_, i) => i % 2 === 1));
    this.#moments = this.#moments.filter((_, i) => i % 2 === 0);
    this.#every *= 2;
  }

  /**
   * Scores a finished walk: yields the mean of each side in dB and the number of moments, after each of them. It ends
   * early if ground truth is unavailable or the signal aborts, and rejects with the reason if there was none at all.
   */
  async *scores(signal: AbortSignal): AsyncGenerator<{ readonly psnr: readonly number[]; readonly moments: number }> {
    const moments = this.#moments;
    this.#moments = [];
    this.forget();
    const sums: number[] = [];
    let scored = 0;
    try {
      for (const { pose, pictures } of moments) {
        const truth = await this.#options.truth(pose, signal);
        const each = this.#options.compare(await Promise.all(pictures), truth);
        truth.close();
        for (const [side, value] of each.entries()) sums[side] = (sums[side] ?? 0) + value;
        scored++;
        yield { psnr: sums.map((sum) => sum / scored), moments: scored };
        signal.throwIfAborted();
      }
    } catch (error) {
      if (scored === 0) throw error;
    } finally {
      this.#drop(moments);
    }
  }

  /** Discards the kept pictures. */
  forget(): void {
    this.#drop(this.#moments);
    this.#moments = [];
    this.#every = EVERY;
    this.#keptAt = Number.NEGATIVE_INFINITY;
  }

  #drop(moments: readonly Moment[]): void {
    for (const { pictures } of moments) for (const picture of pictures) void picture.then((one) => one?.close());
  }
}
