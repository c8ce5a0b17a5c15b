/** Repeats runs of the lab in the simulator, with the same link, head movement and controller, and the run's server and page. */
import type { ControllerFactory } from "#client/abr/controller";
import { firstOffered, offering } from "#client/abr/ladder";
import { seeded } from "#client/abr/random";
import type { Rung } from "#client/wire/render";
import type { TimedPose } from "#viewer/movement/movement";
import { ANIMATION_FRAME, type Endpoints, PaperEndpoints } from "./endpoints";
import { Head } from "./head";
import type { Figures } from "./tally";
import type { LinkState, NetworkTrace } from "./trace";

/** A received frame of the lab. */
export interface LabFrame {
  readonly rung: number;
  readonly bytes: number;
  /** Server times in milliseconds. */
  readonly render: number;
  readonly encode: number;
}

/** A run of an experiment, from its folder and the report's table. */
export interface LabRun {
  readonly network: string;
  /** Round trip in milliseconds. */
  readonly roundTrip: number;
  /** Settings of a constant link. */
  readonly constant?: Pick<LinkState, "up_kbps" | "jitter_ms" | "loss_pct"> | null;
  readonly controller: string;
  /** Size of the viewport. */
  readonly pixels: number;
  readonly seed: number;
  /** Duration in milliseconds. */
  readonly duration: number;
  readonly displayInterval: number | null;
  readonly ladder: readonly Rung[];
  readonly frames: readonly LabFrame[];
  /** Downlink rates in kbit/s, with their start times in milliseconds. */
  readonly link: readonly { readonly at: number; readonly target_kbps: number }[];
  readonly points: readonly TimedPose[];
  /** The figures of `PAIRS`, by name. */
  readonly figures: Readonly<Record<string, number>>;
}

/** Figures of both: the report's name, and the simulator's value in the same unit. */
export const PAIRS: readonly (readonly [name: string, title: string, value: (figures: Figures) => number])[] = [
  ["inputs_within_108ms_pct", "poses within 108 ms, %", ({ inTime }) => 100 * inTime],
  ["motion_to_photon_p50_ms", "motion to photon p50, ms", ({ photonP50 }) => photonP50],
  ["motion_to_photon_p95_ms", "motion to photon p95, ms", ({ photonP95 }) => photonP95],
  ["response_time_p50_ms", "response time p50, ms", ({ responseP50 }) => responseP50],
  ["response_time_p95_ms", "response time p95, ms", ({ responseP95 }) => responseP95],
  ["content_age_mean_ms", "content age, ms", ({ contentAge }) => contentAge],
  ["frames_per_s", "frames/s", ({ framesPerSecond }) => framesPerSecond],
  ["mean_profile", "mean rung", ({ rungOverTime }) => rungOverTime],
  ["profile_changes_per_min", "rung changes/min", ({ switches }) => switches],
  ["received_mbit_s", "Mbit/s", ({ bandwidth }) => bandwidth],
];

/** The server and page of measured runs: times and sizes are drawn from frames of the same or the nearest rung. */
export class MeasuredEndpoints extends PaperEndpoints implements Endpoints {
  readonly #random: () => number;
  readonly #interval: number;
  readonly #byRung: readonly (readonly LabFrame[])[];
  #drawn: LabFrame | undefined;

  constructor(run: LabRun, frames: readonly LabFrame[], seed: number) {
    super(run.ladder, seed);
    this.#random = seeded(seed + 2);
    this.#interval = run.displayInterval ?? ANIMATION_FRAME;
    const measured = run.ladder.map((_, rung) => frames.filter((frame) => frame.rung === rung));
    this.#byRung = measured.map((own, rung) => (own.length > 0 ? own : scaled(measured, rung, run.ladder)));
  }

  override render(rung: number): number {
    const frames = this.#byRung[rung] ?? [];
    this.#drawn = frames[Math.floor(this.#random() * frames.length)];
    return this.#drawn?.render ?? super.render(rung);
  }

  override encode(rung: number): number {
    return this.#drawn?.encode ?? super.encode(rung);
  }

  override bytes(rung: number, now: number): number {
    const frames = this.#byRung[rung] ?? [];
    return frames[Math.floor(this.#random() * frames.length)]?.bytes ?? super.bytes(rung, now);
  }

  override nextAnimationFrame(now: number): number {
    return now + this.#interval;
  }
}

/** The frames of the nearest measured rung, with the ladder's ratio of bytes. */
function scaled(measured: readonly (readonly LabFrame[])[], rung: number, ladder: readonly Rung[]): LabFrame[] {
  const known = measured.flatMap((frames, other) => (frames.length > 0 ? [other] : []));
  const nearest = known.toSorted((a, b) => Math.abs(a - rung) - Math.abs(b - rung))[0];
  const [own, other] = [ladder[rung], ladder[nearest ?? rung]];
  const ratio = own && other ? own.expected_kb / other.expected_kb : 1;
  return (measured[nearest ?? rung] ?? []).map((frame) => ({ ...frame, rung, bytes: Math.round(frame.bytes * ratio) }));
}

/** The run's link as a trace, and the movement of its camera. */
export function conditions({ link, roundTrip, constant, points, duration }: LabRun): {
  trace: NetworkTrace;
  head: Head;
} {
  const { up_kbps, jitter_ms, loss_pct } = constant ?? { up_kbps: 10_000, jitter_ms: 0, loss_pct: 0 };
  const state = { up_kbps, delay_ms: roundTrip / 2, jitter_ms, loss_pct };
  const changes = link.filter(
    ({ at, target_kbps }, i) => i === 0 || (at > 0 && target_kbps !== link[i - 1]?.target_kbps),
  );
  const steps = changes.map(({ at, target_kbps }) => ({ ...state, t_ms: Math.max(0, at), down_kbps: target_kbps }));
  return { trace: { steps, duration }, head: new Head(points, 0) };
}

/** A controller restricted to the rungs that the page offers for its viewport. */
export function offered(create: ControllerFactory, { ladder, pixels }: LabRun): ControllerFactory {
  return (context) => offering(create, context, firstOffered(ladder, pixels));
}

export interface Agreement {
  readonly title: string;
  readonly lab: number;
  readonly simulated: number;
  /** Mean absolute difference of a run. */
  readonly error: number;
  /** Spearman's rank correlation of the runs, and of the controllers' means within each network and round trip. */
  readonly runs: number;
  readonly controllers: number;
}

/** Compares the simulated figures of runs with the lab's. */
export function agreement(runs: readonly (LabRun & { readonly simulated: Figures })[]): Agreement[] {
  return PAIRS.map(([name, title, value]) => {
    const pairs = runs.map((run) => ({ ...run, lab: run.figures[name] ?? Number.NaN, other: value(run.simulated) }));
    const usable = pairs.filter(({ lab, other }) => Number.isFinite(lab) && Number.isFinite(other));
    const conditions = grouped(usable, conditionOf);
    const ranks = conditions.map((members) => {
      const means = grouped(members, ({ controller }) => controller);
      return spearman(
        means.map((each) => mean(each.map(({ lab }) => lab))),
        means.map((each) => mean(each.map(({ other }) => other))),
      );
    });
    return {
      title,
      lab: mean(usable.map(({ lab }) => lab)),
      simulated: mean(usable.map(({ other }) => other)),
      error: mean(usable.map(({ lab, other }) => Math.abs(lab - other))),
      runs: spearman(
        usable.map(({ lab }) => lab),
        usable.map(({ other }) => other),
      ),
      controllers: mean(ranks.filter(Number.isFinite)), // excluding conditions with only equal values
    };
  });
}

/** The condition, network and round trip: the server is busier in some than in others. */
export const conditionOf = ({ network, roundTrip }: LabRun) => `${network} ${roundTrip}`;

function grouped<T>(items: readonly T[], key: (item: T) => string): T[][] {
  const keys = [...new Set(items.map(key))];
  return keys.map((each) => items.filter((item) => key(item) === each));
}

function mean(values: readonly number[]): number {
  return values.reduce((sum, value) => sum + value, 0) / values.length;
}

/** Pearson's correlation of the ranks; equal values share their mean rank. */
export function spearman(a: readonly number[], b: readonly number[]): number {
  const [x, y] = [ranks(a), ranks(b)];
  const [mx, my] = [mean(x), mean(y)];
  const covariance = x.reduce((sum, value, i) => sum + (value - mx) * ((y[i] ?? my) - my), 0);
  const deviation = (values: readonly number[], m: number) => Math.sqrt(values.reduce((s, v) => s + (v - m) ** 2, 0));
  return covariance / (deviation(x, mx) * deviation(y, my));
}

function ranks(values: readonly number[]): number[] {
  return values.map(
    (value) =>
      values.filter((other) => other < value).length + (values.filter((other) => other === value).length - 1) / 2,
  );
}
