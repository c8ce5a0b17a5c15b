/** The protocols over which a stream's segments were fetched, by the browser's own account (Resource Timing). */
export class SegmentProtocols {
  readonly #seen = new Set<string>();
  readonly #observer: PerformanceObserver;

  /** `directory`: the URL that begins those of the segments. */
  constructor(directory: string) {
    this.#observer = new PerformanceObserver((list) => {
      for (const { name, nextHopProtocol } of list.getEntries() as PerformanceResourceTiming[]) {
        const ours = name.startsWith(directory) && name.endsWith(".m4s");
        if (ours && nextHopProtocol !== "") this.#seen.add(nextHopProtocol); // abandoned requests have none
      }
    });
    this.#observer.observe({ type: "resource" });
  }

  /** As ALPN identifiers, such as `h3`. */
  get seen(): string[] {
    return [...this.#seen].sort();
  }

  dispose(): void {
    this.#observer.disconnect();
  }
}
