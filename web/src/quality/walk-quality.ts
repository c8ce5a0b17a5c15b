/**
 * What was seen in the course of a walk, against what should have been: pictures of all sides are kept now and then while the camera
 * moves, and when it stands still, each is held against the view from the pose that the viewer had at that moment. Nothing is asked
 * for during the walk, so that link and renderer belong to what is compared; and one ground truth serves all sides.
 */
import type { ScenePose } from "../view/camera";

/** More moments of a walk are not kept, so that ground truth is soon there; they lie evenly over it. */
const MOST = 6;
/** Between the first moments, in milliseconds; in long walks they lie further apart. */
const EVERY = 500;

/** Closed when it has been scored. */
export type Picture = ImageBitmap;

export interface WalkQualityOptions {
  /** The view from a pose, without loss. */
  readonly truth: (pose: ScenePose, signal: AbortSignal) => Promise<Picture>;
  /** How near each picture is to the truth, in dB; null is a picture of nothing, and so black. */
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

  /** The camera is at `pose`, of a walk that goes on: keep what each side shows, if it is time to; `now` in milliseconds. */
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
   * The walk has ended: the mean of each side in dB, and over how many moments, after each of them. It ends early where there is no
   * truth to be had, or when the signal aborts; rejects with the reason if there was none at all.
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

  /** What was kept belongs to no walk. */
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
