/**
 * Whether a machine keeps up with turning a picture in each animation frame. Without a graphics processor, browsers draw by software,
 * which takes a tenth of a second and slows all of the page down; few of them tell how long it takes, but animation frames come late.
 */
import { median } from "../enhance/median";

/** So many draws in a row are judged; a few, where they are far too slow. */
const DRAWS = 30;
const FEW = 10;
/** Milliseconds between two that are too many: ten frames a second would be no gain over frames as they come. */
const TOO_LONG = 100;
const FAR_TOO_LONG = 250;
/** A longer pause is a hidden page, or one that waited for something else. */
const PAUSE = 1000;

export class KeepingUp {
  #last: number | undefined;
  #intervals: readonly number[] = [];

  /** A picture was drawn in an animation frame, as in the last one. False once that takes too long. */
  drawn(at: number): boolean {
    const interval = at - (this.#last ?? at);
    this.#last = at;
    if (interval > 0 && interval < PAUSE) this.#intervals = [...this.#intervals, interval].slice(-DRAWS);
    const { length } = this.#intervals;
    const usual = length < FEW ? 0 : median(this.#intervals);
    return usual < (length < DRAWS ? FAR_TOO_LONG : TOO_LONG);
  }

  /** Nothing was to be drawn in an animation frame. */
  rested(): void {
    this.#last = undefined;
  }
}
