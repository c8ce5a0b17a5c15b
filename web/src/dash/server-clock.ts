/** The server's clock, as the page can know it: of the last answers, the one that took the shortest way. */

/** Answers that are remembered: clocks drift apart, if slowly. */
const REMEMBERED = 8;

export class ServerClock {
  #answers: { readonly roundTrip: number; readonly offset: number }[] = [];

  /** The server said that it was `time`, in Unix milliseconds; asked and heard on the page's clock. */
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
