/** Always the rung that a person chose: no adaptation. */
import type { Controller } from "./controller";

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
