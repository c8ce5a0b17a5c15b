/** Chooses the profile of each frame. Pure: time comes in with what is observed. */

/** What became of one frame. */
export interface Observation {
  readonly profile: number | null;
  readonly bytes: number;
  /** From sending the request to the last byte, in milliseconds. */
  readonly roundTrip: number;
  /** The link's throughput in bits per second, or null while unknown. */
  readonly throughput: number | null;
  /** On the page's clock, in milliseconds. */
  readonly at: number;
}

export interface Controller {
  /** The ladder's rung for the next frame, 0 the best. */
  decide(): number;
  observe(observation: Observation): void;
}

/** Always the rung that a person chose. */
export class FixedController implements Controller {
  readonly #rung: number;

  constructor(rung: number) {
    this.#rung = rung;
  }

  decide(): number {
    return this.#rung;
  }

  observe(): void {}
}
