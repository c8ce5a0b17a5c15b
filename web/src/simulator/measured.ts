/** Both ends of the network as they were in a real visit, which `benchmarks/simulator.py` writes down. */
import * as v from "valibot";
import { ANIMATION_FRAME, type Endpoints } from "./endpoints";

const Milliseconds = v.pipe(v.number(), v.finite(), v.minValue(0));
const Measured = v.object({
  /** Of each rung, the best first; `page_ms` is decoding and whatever else a frame takes outside the server and the link. */
  rungs: v.pipe(
    v.array(v.object({ render_ms: Milliseconds, encode_ms: Milliseconds, page_ms: Milliseconds })),
    v.minLength(1),
  ),
  /** A frame's bytes at each rung, along the movement. */
  views: v.pipe(
    v.array(v.object({ t_ms: Milliseconds, bytes: v.array(v.pipe(v.number(), v.minValue(1))) })),
    v.minLength(1),
  ),
  /** The page's animation frames: when each was, and how fast the camera turned, in degrees a second. */
  animation: v.array(v.object({ t_ms: Milliseconds, turning: v.pipe(v.number(), v.finite()) })),
});
type Measured = v.InferOutput<typeof Measured>;

export class MeasuredEndpoints implements Endpoints {
  readonly #measured: Measured;
  #view = 0;
  #frame = 0;

  private constructor(measured: Measured) {
    this.#measured = measured;
  }

  /** Throws an Error with one sentence if the text is not what was measured of so many rungs. */
  static parse(text: string, rungs: number): MeasuredEndpoints {
    const measured = v.parse(Measured, JSON.parse(text));
    if ([measured.rungs, ...measured.views.map(({ bytes }) => bytes)].some(({ length }) => length !== rungs)) {
      throw new Error(`What was measured has to say the same of each of ${rungs} rungs.`);
    }
    return new MeasuredEndpoints(measured);
  }

  render(rung: number): number {
    return this.#measured.rungs[rung]?.render_ms ?? 0;
  }

  encode(rung: number): number {
    return this.#measured.rungs[rung]?.encode_ms ?? 0;
  }

  decode(rung: number): number {
    return this.#measured.rungs[rung]?.page_ms ?? 0;
  }

  heard(now: number): number {
    return now;
  }

  bytes(rung: number, now: number): number {
    const { views } = this.#measured;
    while ((views[this.#view + 1]?.t_ms ?? Number.POSITIVE_INFINITY) <= now) this.#view++;
    return views[this.#view]?.bytes[rung] ?? 0;
  }

  /** What was not measured comes 60 times a second. */
  nextAnimationFrame(now: number): number {
    return this.#after(now)?.t_ms ?? now + ANIMATION_FRAME;
  }

  turning(now: number): number {
    this.#after(now);
    return this.#measured.animation[this.#frame - 1]?.turning ?? 0;
  }

  /** The first animation frame after a time. */
  #after(now: number) {
    const { animation } = this.#measured;
    while ((animation[this.#frame]?.t_ms ?? Number.POSITIVE_INFINITY) <= now) this.#frame++;
    return animation[this.#frame];
  }
}
