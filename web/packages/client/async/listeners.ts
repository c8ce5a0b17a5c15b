/** Subscribers of an event. */
export class Listeners<T extends unknown[]> {
  readonly #all = new Set<(...news: T) => void>();

  /** Subscribes; returns a function that unsubscribes. */
  readonly add = (listener: (...news: T) => void): (() => void) => {
    this.#all.add(listener);
    return () => this.#all.delete(listener);
  };

  readonly tell = (...news: T): void => {
    for (const listener of this.#all) listener(...news);
  };
}
