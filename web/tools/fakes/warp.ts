/** For tests: a warp that records its calls, and a reprojector that uses it. */
import type { DepthMap } from "#client/transport/transport";
import type { Warper } from "#viewer/reproject/reprojector";
import type { View } from "#viewer/reproject/view";
import type { WarpOptions } from "#viewer/reproject/warp";

export class FakeWarp implements Warper {
  working = true;
  readonly gpuMs = 0.5;
  taken: { readonly source: unknown; readonly view: View; readonly depth: DepthMap | null }[] = [];
  drawn: View[] = [];
  sides: View[] = [];
  forgotten = 0;
  disposed = false;
  readonly canvas: HTMLCanvasElement;
  readonly options: WarpOptions;

  constructor(canvas: HTMLCanvasElement, options: WarpOptions) {
    this.canvas = canvas;
    this.options = options;
  }

  take(source: TexImageSource, view: View, depth: DepthMap | null): void {
    this.taken.push({ source, view, depth });
  }

  surround(_source: TexImageSource, view: View): void {
    this.sides.push(view);
  }

  draw(view: View): void {
    this.drawn.push(view);
  }

  forget(): void {
    this.forgotten++;
  }

  dispose(): void {
    this.disposed = true;
  }

  lose(): void {
    this.working = false;
    this.options.onLost?.();
  }

  restore(): void {
    this.working = true;
    this.options.onRestored?.();
  }
}
