/** A device and renderer for tests: nothing is drawn, and the test completes frames. */

import { PAPER_LADDER } from "#client/abr/ladder";
import { type Deferred, deferred } from "#client/async/deferred";
import type { Chain, Place } from "#viewer/enhance/chain";
import type { Size } from "#viewer/enhance/geometry";
import type { Enhancer, Loaded } from "#viewer/enhance/model/enhancer";
import type { Drawn, Picture } from "#viewer/enhance/renderer";
import { COURTYARD } from "./server";

export class FakeDevice {
  readonly features = new Set<string>();
  readonly #loss = deferred<GPUDeviceLostInfo>();
  readonly lost = this.#loss.promise;
  destroyed = false;
  #onError: ((event: GPUUncapturedErrorEvent) => void) | undefined;

  createTexture(): GPUTexture {
    return { destroy: () => undefined } as unknown as GPUTexture;
  }

  addEventListener(_: string, listener: (event: GPUUncapturedErrorEvent) => void): void {
    this.#onError = listener;
  }

  complain(message: string): void {
    this.#onError?.({ error: { message }, preventDefault: () => undefined } as GPUUncapturedErrorEvent);
  }

  lose(): void {
    this.#loss.resolve({ reason: "unknown", message: "" } as GPUDeviceLostInfo);
  }

  destroy(): void {
    this.destroyed = true;
    this.lose();
  }
}

interface FakeFrame {
  readonly bitmap: unknown;
  readonly label: string;
  readonly size: Size;
  readonly done: Deferred<number>;
}

export class FakeRenderer {
  readonly frames: FakeFrame[] = [];
  readonly released: Drawn[] = [];
  readonly warm: Picture[] = [];

  async warmUp(chain: Chain, picture: Picture): Promise<void> {
    chain.run({} as GPUCommandEncoder, {} as GPUTexture, picture.rung);
    this.warm.push(picture);
  }

  draw(bitmap: ImageBitmap, rung: number | null, chain: Chain, size: Size): Drawn {
    chain.run({} as GPUCommandEncoder, chain.input(bitmap), rung);
    const done = deferred<number>();
    this.frames.push({ bitmap, label: chain.label, size, done });
    return { ...size, done: done.promise };
  }

  release(drawn: Drawn): void {
    this.released.push(drawn);
  }

  copy(drawn: Drawn): ImageBitmap {
    if (this.released.includes(drawn)) throw new Error("the frame was released");
    return { width: drawn.width, height: drawn.height } as ImageBitmap;
  }
}

export const PLACE: Place = { scene: COURTYARD, ladder: PAPER_LADDER, host: {} };

export const NO_WORK: Loaded = { run: (_, input) => input, dispose: () => undefined };

/** A model without effect, which may fail. */
export function fakeModel(name: string, part: Partial<Enhancer> = {}, run?: Loaded["run"]) {
  const model = {
    name,
    label: name.toUpperCase(),
    kind: "upscale" as const,
    scale: 1,
    disposed: 0,
    load: async (): Promise<Loaded> => ({ run: run ?? NO_WORK.run, dispose: () => model.disposed++ }),
    ...part,
  };
  return model;
}
