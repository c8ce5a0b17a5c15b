/** Different parts of traces, for comparisons that need many. */
import { type NetworkTrace, TracePlayer } from "./trace";

/** A part of a trace, with the state at its start. */
export function cut(trace: NetworkTrace, start: number, duration: number): NetworkTrace {
  const { t_ms: _, ...state } = { t_ms: 0, ...new TracePlayer(trace).at(start) };
  const within = trace.steps.filter(({ t_ms }) => t_ms > start && t_ms < start + duration);
  return { steps: [{ ...state, t_ms: 0 }, ...within.map((step) => ({ ...step, t_ms: step.t_ms - start }))], duration };
}

export interface Segment {
  /** Name of the trace. */
  readonly name: string;
  /** Milliseconds from its beginning. */
  readonly start: number;
  readonly trace: NetworkTrace;
}

/**
 * Random non-overlapping parts of all traces in turn; fewer if there are not enough. Parts without any capacity are
 * skipped.
 */
export function segments(
  traces: readonly { readonly name: string; readonly trace: NetworkTrace }[],
  count: number,
  duration: number,
  random: () => number,
): Segment[] {
  const decks = traces.map(({ name, trace }) => {
    const parts = Array.from({ length: Math.floor(trace.duration / duration) }, (_, i) => {
      const start = i * duration;
      return { name, start, trace: cut(trace, start, duration), key: random() };
    });
    return parts
      .filter((part) => part.trace.steps.some(({ down_kbps }) => down_kbps > 0))
      .toSorted((a, b) => a.key - b.key)
      .map(({ key: _, ...part }) => part);
  });
  const chosen: Segment[] = [];
  for (let round = 0; chosen.length < count; round++) {
    const dealt = decks.flatMap((deck) => deck.slice(round, round + 1));
    if (dealt.length === 0) break;
    chosen.push(...dealt);
  }
  return chosen.slice(0, count);
}
