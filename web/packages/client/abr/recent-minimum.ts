/** The least of the values of the last milliseconds. */
export class RecentMinimum {
  readonly #span: number;
  /** Possible minima: ascending in time and value. */
  #values: { readonly at: number; readonly value: number }[] = [];

  /** `span` in milliseconds. */
  constructor(span: number) {
    this.#span = span;
  }

  /** A value at a time that never goes back; returns the least, which may be this one. */
  add(value: number, at: number): number {
    this.#values = this.#values.filter((older) => older.at > at - this.#span && older.value < value);
    this.#values.push({ at, value });
    return this.#values[0]?.value ?? value;
  }
}
