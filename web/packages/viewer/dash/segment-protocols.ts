/** The protocols over which a stream's segments were fetched, as reported by the browser (Resource Timing). */
export class SegmentProtocols {
  readonly #seen = new Set<string>();
  readonly #observer: PerformanceObserver;

  /** `directory` is the common prefix of the segments' URLs. */
  constructor(directory: string) {
    this.#observer = new PerformanceObserver((list) => {
      for (const { name, nextHopProtocol } of list.getEntries() as PerformanceResourceTiming[]) {
        const ours = name.startsWith(directory) && name.endsWith(".m4s");
        if (ours && nextHopProtocol !== "") this.#seen.add(nextHopProtocol); // abandoned requests have no protocol
      }
    });
    this.#observer.observe({ type: "resource" });
  }

  /** The protocols as ALPN identifiers, such as `h3`. */
  get seen(): string[] {
    return [...this.#seen].sort();
  }

  dispose(): void {
    this.#observer.disconnect();
  }
}
