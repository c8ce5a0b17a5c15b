/** Those who hear of something, each until it has heard enough. */
export class Listeners<T extends unknown[]> {
  readonly #all = new Set<(...news: T) => void>();

  /** Hear of it, until the function that this returns is called. */
  readonly add = (listener: (...news: T) => void): (() => void) => {
    this.#all.add(listener);
    return () => this.#all.delete(listener);
  };

  readonly tell = (...news: T): void => {
    for (const listener of this.#all) listener(...news);
  };
}
