/** A network trace in the project's CSV format (docs/network.md), as the simulator plays it: in a loop. */

export interface LinkState {
  readonly down_kbps: number;
  readonly up_kbps: number;
  readonly delay_ms: number;
  readonly jitter_ms: number;
  readonly loss_pct: number;
}

export interface Step extends LinkState {
  readonly t_ms: number;
}

export interface NetworkTrace {
  readonly steps: readonly Step[];
  readonly duration: number;
}

const FIRST: LinkState = { down_kbps: Number.NaN, up_kbps: 10_000, delay_ms: 0, jitter_ms: 0, loss_pct: 0 };

/** Throws an Error with one sentence if the text is not a trace. */
export function parseTrace(text: string): NetworkTrace {
  const [header = "", ...lines] = text.trim().split(/\r?\n/);
  const columns = header.split(",").map((name) => name.trim());
  const steps: Step[] = [];
  let state = FIRST;
  let end = 0;
  for (const [i, line] of lines.entries()) {
    const cells = line.split(",");
    const row = Object.fromEntries(columns.flatMap((name, c) => (cells[c]?.trim() ? [[name, Number(cells[c])]] : [])));
    const { t_ms, ...changes } = row;
    state = { ...state, ...changes };
    const numbers = [t_ms, ...Object.values(state)];
    if (t_ms === undefined || !numbers.every((value) => Number.isFinite(value) && Number(value) >= 0)) {
      throw new Error(`Line ${i + 2} is not a step of a network trace: ${line}`);
    }
    if (steps.length > 0 && t_ms <= end) throw new Error(`Line ${i + 2} is not later than the one before.`);
    end = t_ms;
    const isEnd = Object.keys(changes).length === 0 && i === lines.length - 1 && steps.length > 0;
    if (!isEnd) steps.push({ t_ms, ...state });
  }
  const last = steps.at(-1);
  if (last === undefined) throw new Error("The trace has no steps.");
  if (end === last.t_ms) end += steps.length > 1 ? last.t_ms - (steps.at(-2)?.t_ms ?? 0) : 1000;
  if (steps.every(({ down_kbps }) => down_kbps === 0)) throw new Error("The trace never lets anything through.");
  return { steps, duration: end };
}

/** The state at a time, for times that never decrease. */
export class TracePlayer {
  readonly #trace: NetworkTrace;
  #i = 0;
  #lap = 0;

  constructor(trace: NetworkTrace) {
    this.#trace = trace;
  }

  at(time: number): LinkState {
    const { steps, duration } = this.#trace;
    while (time >= this.#lap + duration) {
      this.#lap += duration;
      this.#i = 0;
    }
    while ((steps[this.#i + 1]?.t_ms ?? Number.POSITIVE_INFINITY) <= time - this.#lap) this.#i++;
    return steps[this.#i] as Step;
  }
}
