/** A page for tests of whole viewers in a DOM without graphics: animation frames, workers and connections. */

import { vi } from "vitest";
import type { Connected } from "#client/transport/connect";
import { FakeTransport, settle } from "./transport";

/** A worker that does nothing, as transports are fake. */
class FakeWorker {
  postMessage(): void {}
  terminate(): void {}
}

/** Reports the size of a stage at once for every observed element. */
class LaidOut {
  readonly #changed: () => void;
  constructor(changed: () => void) {
    this.#changed = changed;
  }
  observe(element: Element): void {
    Object.defineProperties(element, { clientWidth: { value: 1280 }, clientHeight: { value: 720 } });
    this.#changed();
  }
  disconnect(): void {}
}

/** Stubs the page's globals until the test undoes all stubs and mocks. */
export class FakePage {
  now = 0;
  readonly transports: FakeTransport[] = [];
  readonly animationFrames = new Map<number, () => void>();
  #id = 0;

  constructor() {
    const context = { transferFromImageBitmap: () => undefined };
    const only = (kind: string) => (kind === "bitmaprenderer" ? context : null);
    vi.spyOn(HTMLCanvasElement.prototype, "getContext").mockImplementation(only as never);
    vi.stubGlobal("Worker", FakeWorker);
    vi.stubGlobal("ResizeObserver", LaidOut);
    vi.stubGlobal("requestAnimationFrame", (callback: () => void) => {
      this.animationFrames.set(++this.#id, callback);
      return this.#id;
    });
    vi.stubGlobal("cancelAnimationFrame", (cancelled: number) => this.animationFrames.delete(cancelled));
    vi.spyOn(performance, "now").mockImplementation(() => this.now);
  }

  connected(host: string | null = null): Connected {
    const transport = new FakeTransport(() => this.now);
    this.transports.push(transport);
    return { transport, fallback: null, host };
  }

  requests() {
    return this.transports.flatMap(({ requests }) => requests.map(({ request }) => request));
  }

  /** Runs animation frames at 50 Hz; the server answers all requests if `answer`. */
  async frames(count: number, { answer = true } = {}): Promise<void> {
    for (let i = 0; i < count; i++) {
      this.now += 20;
      for (const [id, callback] of [...this.animationFrames]) {
        this.animationFrames.delete(id);
        callback();
      }
      if (answer) for (const { requests } of this.transports) for (const { reply } of requests) reply();
      await settle();
    }
  }
}
