/** A clock that jumps from event to event, and lets promises settle in between. */

interface Event {
  readonly at: number;
  readonly order: number;
  readonly run: () => void;
}

/** More than any chain of promises that an event triggers. */
const TURNS = 16;

export class EventLoop {
  #now = 0;
  #order = 0;
  #awaited = false;
  /** A binary heap: earliest first, then oldest first. */
  readonly #heap: Event[] = [];

  /** Milliseconds since the start. */
  readonly now = (): number => this.#now;

  at(time: number, run: () => void): void {
    const heap = this.#heap;
    const event = { at: Math.max(time, this.#now), order: this.#order++, run };
    let i = heap.length;
    while (i > 0) {
      const parent = (i - 1) >> 1;
      const above = heap[parent] as Event;
      if (!before(event, above)) break;
      heap[i] = above;
      i = parent;
    }
    heap[i] = event;
  }

  /** Lets all promises settle after an event, before time advances. */
  settle(): void {
    this.#awaited = true;
  }

  async run(until: number): Promise<void> {
    for (let event = this.#heap[0]; event !== undefined && event.at <= until; event = this.#heap[0]) {
      this.#pop();
      this.#now = event.at;
      event.run();
      if (!this.#awaited) continue;
      this.#awaited = false;
      for (let i = 0; i < TURNS; i++) await Promise.resolve();
    }
    this.#now = until;
  }

  #pop(): void {
    const heap = this.#heap;
    const last = heap.pop() as Event;
    if (heap.length === 0) return;
    let i = 0;
    for (;;) {
      let child = 2 * i + 1;
      if (child >= heap.length) break;
      if (child + 1 < heap.length && before(heap[child + 1] as Event, heap[child] as Event)) child++;
      if (!before(heap[child] as Event, last)) break;
      heap[i] = heap[child] as Event;
      i = child;
    }
    heap[i] = last;
  }
}

function before(a: Event, b: Event): boolean {
  return a.at < b.at || (a.at === b.at && a.order < b.order);
}
