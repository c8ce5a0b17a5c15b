/** The parts of its trace and movement that an experiment plays, chosen as in `tigas_experiments/run/segments.py`. Pure. */
import { seeded } from "../abr/random";

/** Where a part begins, in seconds. */
export interface Segment {
  readonly trace_s: number;
  readonly movement_s: number;
}

interface Wanted {
  readonly count: number;
  /** Of each part. */
  readonly length_s: number;
  /** How long the trace lasts; null: a link that does not change. */
  readonly trace_s: number | null;
  readonly movement_s: number;
  readonly seed: number;
}

/**
 * Parts of the trace that do not overlap, by chance, each with a part of the movement, which overlap where it is too short for
 * all. One part is the beginning of both. A sentence if there is no room.
 */
export function segments({ count, length_s, trace_s, movement_s, seed }: Wanted): readonly Segment[] | string {
  if (count === 1) return [{ trace_s: 0, movement_s: 0 }];
  const room = trace_s === null ? count : Math.floor(trace_s / length_s);
  if (room < count) return `The trace has room for ${room} parts of ${length_s} s, not for ${count}.`;
  if (movement_s < length_s) return `The movement lasts ${movement_s.toFixed(1)} s, less than a run’s ${length_s} s.`;
  const random = seeded(seed);
  const traces = trace_s === null ? Array<number>(count).fill(0) : apart(trace_s, length_s, count, random);
  const movements =
    movement_s >= length_s * count
      ? apart(movement_s, length_s, count, random)
      : traces.map((_, place) => milliseconds((place * (movement_s - length_s)) / (count - 1)));
  const mixed = shuffled(movements, random);
  return traces.map((begins, place) => ({ trace_s: begins, movement_s: mixed[place] ?? 0 }));
}

/** The values in an order by chance. */
export function shuffled<T>(values: readonly T[], random: () => number): T[] {
  return values
    .map((value) => ({ value, key: random() }))
    .toSorted((a, b) => a.key - b.key)
    .map(({ value }) => value);
}

/** Uniformly among all ways to place them. */
function apart(total: number, length: number, count: number, random: () => number): number[] {
  const gaps = Array.from({ length: count }, () => random() * (total - length * count)).toSorted((a, b) => a - b);
  return gaps.map((gap, place) => milliseconds(place * length + gap));
}

/** Whole ones, rounded down, so that a part ends before the whole. */
function milliseconds(seconds: number): number {
  return Math.floor(seconds * 1000) / 1000;
}
