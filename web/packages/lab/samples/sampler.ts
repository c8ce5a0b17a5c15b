/** Stores every nth frame that a run shows, without ever making the page wait. */

import type { Sample } from "#client/wire/store";
import { OFF } from "#viewer/enhance/model/enhancer";
import type { ShownFrame } from "#viewer/stateless/stateless-player";
import type { About } from "./layout";
import { SamplesRefused, SampleWriter } from "./sample-writer";

export interface Sampled {
  /** Key of the folder; null without one. */
  readonly key: string | null;
  readonly kept: number;
  /** Number of samples that were due but are missing, for example because the disk is too slow. */
  readonly missed: number;
  /** Why sampling ended before the run, in one sentence. */
  readonly problem: string | null;
}

/** Why there are fewer samples than intended, in one sentence; null if there are not. */
export function whyFewer({ problem, missed, kept }: Sampled): string | null {
  return problem ?? (missed === 0 ? null : `Of ${kept + missed} samples, ${missed} could not be stored.`);
}

/** The most samples being written at once; more would fill the browser's memory. */
const MOST_WAITING = 16;
/** The most samples of a run that a store accepts. */
const MOST_SAMPLES = 10_000;

type Writer = Pick<SampleWriter, "key" | "keep" | "close">;

export class Sampler {
  readonly #writer: Writer | null;
  readonly #stride: number;
  #startedAt: number | undefined;
  readonly #seqs = new Set<number>();
  readonly #waiting = new Set<Promise<void>>();
  #shown = 0;
  #kept = 0;
  #missed = 0;
  #problem: string | null;

  private constructor(writer: Writer | null, stride: number, problem: string | null) {
    this.#writer = writer;
    this.#stride = stride;
    this.#problem = problem;
  }

  /** Opens storage for samples; the run continues if nothing can be stored. */
  static async open(
    about: About | null,
    stride: number,
    open: (about: About | null) => Promise<Writer> = SampleWriter.open,
  ): Promise<Sampler> {
    try {
      return new Sampler(await open(about), stride, null);
    } catch (error) {
      if (!(error instanceof SamplesRefused)) throw error;
      return new Sampler(null, stride, `${error.message} Nothing was sampled.`);
    }
  }

  /** The run begins now, on the page's clock. */
  begin(now: number): void {
    this.#startedAt = now;
  }

  shown(frame: ShownFrame): void {
    if (this.#startedAt === undefined || this.#writer === null || this.#problem !== null) return;
    if (this.#shown++ % this.#stride !== 0) return;
    const { seq } = frame.asked;
    // A new connection restarts the numbers, and a sample's number is its name.
    if (this.#waiting.size >= MOST_WAITING || this.#seqs.size >= MOST_SAMPLES || this.#seqs.has(seq)) {
      this.#missed++;
      return;
    }
    let picture: ImageBitmap | null;
    try {
      picture = frame.enhanced?.copy() ?? null;
    } catch {
      this.#missed++; // the graphics processor was lost
      return;
    }
    this.#seqs.add(seq);
    const kept = this.#keep(this.#writer, frame, picture, this.#startedAt).finally(() => this.#waiting.delete(kept));
    this.#waiting.add(kept);
  }

  /** Resolves once all samples are written. */
  async finish(): Promise<Sampled> {
    await Promise.all(this.#waiting);
    await this.#writer?.close();
    return { key: this.#writer?.key ?? null, kept: this.#kept, missed: this.#missed, problem: this.#problem };
  }

  async #keep(
    writer: Writer,
    { at, asked, header, image, enhanced }: ShownFrame,
    picture: ImageBitmap | null,
    startedAt: number,
  ): Promise<void> {
    const sample: Sample = {
      seq: asked.seq,
      at: at - startedAt,
      request: asked,
      rung: header.profile ?? null,
      bytes: image.size,
      restore: enhanced?.restore ?? OFF,
      upscale: enhanced?.upscale ?? OFF,
      enhance_ms: enhanced?.ms ?? null,
      width: enhanced?.width ?? header.width ?? asked.width,
      height: enhanced?.height ?? header.height ?? asked.height,
      enhanced: picture !== null,
    };
    try {
      await writer.keep(sample, image, picture);
      this.#kept++;
    } catch (error) {
      this.#problem ??= `${error instanceof Error ? error.message : error} Sampling ended after ${this.#kept} frames.`;
    }
  }
}
