/** The page's estimate of the server's clock: the recent answer with the shortest round trip. */

/** Answers that are remembered: clocks drift apart, if slowly. */
const REMEMBERED = 8;

export class ServerClock {
  #answers: { readonly roundTrip: number; readonly offset: number }[] = [];

  /** Takes the server's `time` in Unix milliseconds, with the times of question and answer on the page's clock. */
  heard(time: number, askedAt: number, heardAt: number): void {
    const answer = { roundTrip: heardAt - askedAt, offset: time - (askedAt + heardAt) / 2 };
    this.#answers = [...this.#answers.slice(1 - REMEMBERED), answer];
  }

  /** Its time, in Unix milliseconds, at a moment of the page's clock; NaN before the first answer. */
  at(now: number): number {
    const [best] = this.#answers.toSorted((a, b) => a.roundTrip - b.roundTrip);
    return now + (best?.offset ?? Number.NaN);
  }
}
