/** Sums up a simulated visit. */

import { decibels, type Seen } from "#client/abr/seen-error";
import { INTERACTIVE_MS } from "#client/wire/figures";
import type { Rung } from "#client/wire/render";
import type { PresentedFrame } from "#viewer/view/presented";
import type { Stalls } from "#viewer/view/stalls";

export interface Figures {
  /**
   * Share of poses with a motion-to-photon latency of at most `INTERACTIVE_MS`: every pose counts, requested or not, shown
   * or not.
   */
  readonly inTime: number;
  /** Share of frames with a response time (request to last byte) of at most `INTERACTIVE_MS`. */
  readonly responsesInTime: number;
  /** Response time of frames, in milliseconds. */
  readonly responseP50: number;
  readonly responseP95: number;
  readonly responseMean: number;
  /** Motion-to-photon latency of poses in milliseconds; for poses never shown, their wait at the end. */
  readonly photonP50: number;
  readonly photonP95: number;
  readonly photonMean: number;
  /** Mean milliseconds from a frame's own pose to the screen: request, answer and page. */
  readonly age: number;
  /** Error of the seen picture (seen-error.ts) over all animation frames: means of squared error, PSNR and SSIM. */
  readonly viewError: number;
  readonly viewPsnr: number;
  readonly viewSsim: number;
  /** Mean age of the seen pixels over all animation frames, in milliseconds. */
  readonly contentAge: number;
  /** Lines of the picture on screen half a second, one, two and five seconds after the start; 0: none yet. */
  readonly linesAt500: number;
  readonly linesAt1000: number;
  readonly linesAt2000: number;
  readonly linesAt5000: number;
  /** Mean rung of the frames shown, 0 the best. */
  readonly rung: number;
  /** Mean rung, weighted by time on screen. */
  readonly rungOverTime: number;
  /** Mean number of halvings from the best frame's expected bytes to those shown, weighted by time on screen. */
  readonly halvings: number;
  /** Changes of rung between frames shown, a minute. */
  readonly switches: number;
  readonly framesPerSecond: number;
  /** Received megabits per second. */
  readonly bandwidth: number;
  /** Stalls per minute, and their share of the time. */
  readonly stalls: number;
  readonly stalled: number;
}

export class Tally {
  readonly #responses: number[] = [];
  readonly #latencies: number[] = [];
  #bytes = 0;
  #ages = 0;
  #shown = 0;
  #rungs = 0;
  #switches = 0;
  #weighted = 0;
  #halvings = 0;
  #firstAt = 0;
  #last: PresentedFrame | undefined;
  #views = 0;
  #errors = 0;
  #decibels = 0;
  #similarity = 0;
  /** Changes of the picture's size: times, and numbers of lines. */
  readonly #lines: { readonly at: number; readonly lines: number }[] = [];
  #contentAges = 0;

  readonly #ladder: readonly Rung[];

  constructor(ladder: readonly Rung[]) {
    this.#ladder = ladder;
  }

  replied(response: number, bytes: number): void {
    this.#responses.push(response);
    this.#bytes += bytes;
  }

  presented(frame: PresentedFrame): void {
    const rung = frame.rung ?? 0;
    const last = this.#last;
    if (this.#lines.at(-1)?.lines !== frame.height) this.#lines.push({ at: frame.at, lines: frame.height });
    if (last === undefined) {
      this.#firstAt = frame.at;
    } else {
      this.#weighted += (last.rung ?? 0) * (frame.at - last.at);
      this.#halvings += this.#below(last.rung ?? 0) * (frame.at - last.at);
      if (last.rung !== rung) this.#switches++;
    }
    this.#shown++;
    this.#rungs += rung;
    this.#ages += Math.min(...frame.latencies); // a frame's own pose is the newest that it shows
    for (const latency of frame.latencies) this.#latencies.push(latency);
    this.#last = frame;
  }

  /**
   * At the end of the visit, the wait of each pose never shown, in milliseconds. Poses that could still have been in
   * time are excluded.
   */
  unanswered(waits: readonly number[]): void {
    for (const wait of waits) if (wait > INTERACTIVE_MS) this.#latencies.push(wait);
  }

  /** Records error and age of the picture in an animation frame. */
  seen({ mse, ssim }: Seen, age: number): void {
    this.#views++;
    this.#errors += mse;
    this.#decibels += decibels(mse);
    this.#similarity += ssim;
    this.#contentAges += age;
  }

  #linesAt(time: number): number {
    return this.#lines.findLast(({ at }) => at <= time)?.lines ?? 0;
  }

  #below(rung: number): number {
    const [best, own] = [this.#ladder[0], this.#ladder[rung]];
    return best && own ? Math.log2(best.expected_kb / own.expected_kb) : 0;
  }

  figures(duration: number, stalls: Stalls): Figures {
    const responses = Float64Array.from(this.#responses).sort();
    const latencies = Float64Array.from(this.#latencies).sort();
    const minutes = duration / 60_000;
    const visible = Math.max(1, (this.#last?.at ?? 0) - this.#firstAt);
    return {
      inTime: share(latencies),
      responsesInTime: share(responses),
      responseP50: percentile(responses, 0.5),
      responseP95: percentile(responses, 0.95),
      responseMean: responses.reduce((sum, value) => sum + value, 0) / Math.max(1, responses.length),
      photonP50: percentile(latencies, 0.5),
      photonP95: percentile(latencies, 0.95),
      photonMean: latencies.reduce((sum, value) => sum + value, 0) / Math.max(1, latencies.length),
      age: this.#ages / Math.max(1, this.#shown),
      viewError: this.#errors / Math.max(1, this.#views),
      viewPsnr: this.#decibels / Math.max(1, this.#views),
      viewSsim: this.#similarity / Math.max(1, this.#views),
      linesAt500: this.#linesAt(500),
      linesAt1000: this.#linesAt(1000),
      linesAt2000: this.#linesAt(2000),
      linesAt5000: this.#linesAt(5000),
      contentAge: this.#contentAges / Math.max(1, this.#views),
      rung: this.#rungs / Math.max(1, this.#shown),
      rungOverTime: this.#weighted / visible,
      halvings: this.#halvings / visible,
      switches: this.#switches / minutes,
      framesPerSecond: (this.#shown * 1000) / duration,
      bandwidth: (this.#bytes * 8) / duration / 1000,
      stalls: stalls.count / minutes,
      stalled: stalls.time / duration,
    };
  }
}

function share(sorted: Float64Array): number {
  return sorted.filter((value) => value <= INTERACTIVE_MS).length / Math.max(1, sorted.length);
}

/** The nearest-rank percentile. */
function percentile(sorted: Float64Array, rank: number): number {
  return sorted[Math.max(0, Math.ceil(rank * sorted.length) - 1)] ?? Number.NaN;
}
