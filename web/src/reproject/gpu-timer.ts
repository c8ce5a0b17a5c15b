/** How long what was drawn took the graphics processor, where it tells: the answer comes some frames later. */

/** EXT_disjoint_timer_query_webgl2. */
interface TimerExtension {
  readonly TIME_ELAPSED_EXT: GLenum;
  readonly GPU_DISJOINT_EXT: GLenum;
}

/** While so many are awaited, nothing is timed. */
const MOST_AWAITED = 4;

export class GpuTimer {
  readonly #gl: WebGL2RenderingContext;
  readonly #extension: TimerExtension | null;
  #awaited: readonly WebGLQuery[] = [];
  #running: WebGLQuery | null = null;
  /** The newest that is known, in milliseconds. */
  ms: number | null = null;

  constructor(gl: WebGL2RenderingContext) {
    this.#gl = gl;
    this.#extension = gl.getExtension("EXT_disjoint_timer_query_webgl2") as TimerExtension | null;
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

  delete(): void {
    for (const query of this.#awaited) this.#gl.deleteQuery(query);
    this.#awaited = [];
  }

  #collect({ GPU_DISJOINT_EXT }: TimerExtension): void {
    const gl = this.#gl;
    const waiting = this.#awaited.findIndex((query) => !gl.getQueryParameter(query, gl.QUERY_RESULT_AVAILABLE));
    const done = waiting === -1 ? this.#awaited : this.#awaited.slice(0, waiting);
    const newest = done.at(-1);
    // The clock was interrupted, for instance by a change of the processor's frequency: what it says means nothing.
    if (newest && !gl.getParameter(GPU_DISJOINT_EXT)) this.ms = gl.getQueryParameter(newest, gl.QUERY_RESULT) / 1e6;
    for (const query of done) gl.deleteQuery(query);
    this.#awaited = this.#awaited.slice(done.length);
  }
}
