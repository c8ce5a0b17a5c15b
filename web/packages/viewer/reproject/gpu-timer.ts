/** GPU time of draws, where available: results follow some frames later. */

import { median } from "../enhance/median";

/** EXT_disjoint_timer_query_webgl2. */
interface TimerExtension {
  readonly TIME_ELAPSED_EXT: GLenum;
  readonly GPU_DISJOINT_EXT: GLenum;
}

/** Number of measurements in the median. */
const REMEMBERED = 15;
/** Maximum number of pending queries; further draws are not timed. */
const MOST_AWAITED = 4;

export class GpuTimer {
  readonly #gl: WebGL2RenderingContext;
  readonly #extension: TimerExtension | null;
  #awaited: readonly WebGLQuery[] = [];
  #running: WebGLQuery | null = null;
  readonly #times: number[] = [];

  constructor(gl: WebGL2RenderingContext) {
    this.#gl = gl;
    this.#extension = gl.getExtension("EXT_disjoint_timer_query_webgl2") as TimerExtension | null;
  }

  /** The median of the last ones, in milliseconds; null until there are enough of them. */
  get ms(): number | null {
    return this.#times.length < REMEMBERED ? null : median(this.#times);
  }

  begin(): void {
    if (this.#extension === null) return;
    this.#collect(this.#extension);
    if (this.#awaited.length >= MOST_AWAITED) return;
    this.#running = this.#gl.createQuery();
    this.#gl.beginQuery(this.#extension.TIME_ELAPSED_EXT, this.#running);
  }

  end(): void {
    if (this.#extension === null || this.#running === null) return;
    this.#gl.endQuery(this.#extension.TIME_ELAPSED_EXT);
    this.#awaited = [...this.#awaited, this.#running];
    this.#running = null;
  }

  #collect({ GPU_DISJOINT_EXT }: TimerExtension): void {
    const gl = this.#gl;
    const waiting = this.#awaited.findIndex((query) => !gl.getQueryParameter(query, gl.QUERY_RESULT_AVAILABLE));
    const done = waiting === -1 ? this.#awaited : this.#awaited.slice(0, waiting);
    // The clock was interrupted, for instance by a change of the GPU's frequency: the result is meaningless.
    const absurd = done.length > 0 && gl.getParameter(GPU_DISJOINT_EXT);
    for (const query of done) {
      if (!absurd) this.#times.push(gl.getQueryParameter(query, gl.QUERY_RESULT) / 1e6);
      gl.deleteQuery(query);
    }
    this.#times.splice(0, this.#times.length - REMEMBERED);
    this.#awaited = this.#awaited.slice(done.length);
  }
}
