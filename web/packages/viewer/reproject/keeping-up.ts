/**
 * Whether a machine keeps up with turning a picture in each animation frame. Without graphics acceleration, browsers draw in software,
 * which takes a tenth of a second and slows the whole page. Few of them report draw times, but animation frames arrive late.
 */
import { median } from "../enhance/median";

/** Number of draws that are judged, and the number that suffices if they are far too slow. */
const DRAWS = 30;
const FEW = 3;
/** The same if the user insists on turning, as the first draws of a busy page are slow. */
const FEW_FORCED = 10;
/** Too many milliseconds between two draws: ten frames per second would be no better than unturned ones. */
const TOO_LONG = 100;
const FAR_TOO_LONG = 250;
/** No draw takes so long: the page waited for something else, such as its own start (ms). */
const PAUSE = 1000;

export class KeepingUp {
  #last: number | undefined;
  #intervals: readonly number[] = [];
  readonly #few: number;

  constructor(forced = false) {
    this.#few = forced ? FEW_FORCED : FEW;
  }

  /** Records a draw in an animation frame. Returns false once draws take too long. */
  drawn(at: number): boolean {
    const interval = at - (this.#last ?? at);
    this.#last = at;
    if (interval > 0 && interval < PAUSE) this.#intervals = [...this.#intervals, interval].slice(-DRAWS);
    const { length } = this.#intervals;
    const usual = length < this.#few ? 0 : median(this.#intervals);
    return usual < (length < DRAWS ? FAR_TOO_LONG : TOO_LONG);
  }

  /** Records an animation frame without a draw, or a hidden page. */
  rested(): void {
    this.#last = undefined;
  }
}
