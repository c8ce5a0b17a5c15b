/** The form that sets up an experiment: turns a draft into a plan, or into a sentence on the problem. Pure. */
import type { FrameRate } from "../dash/presets";
import type { PredictorName } from "../predict/registry";
import {
  type ExperimentPlan,
  isPerView,
  MAX_REPEATS,
  MAX_SEGMENTS,
  type Network,
  type Profile,
  type RunMode,
} from "./plan";
import { segments } from "./segments";

export interface Draft {
  readonly name: string;
  /** The chosen movement, as the list of movements knows it. */
  readonly movement: string | null;
  /** Name at the shaper; null: the current link. */
  readonly trace: string | null;
  /** As typed, in milliseconds; empty: the trace's own. */
  readonly rtt: string;
  readonly modes: readonly RunMode[];
  readonly profiles: readonly Profile[];
  /** Of the modes with DASH, in frames a second; null: the preset's own. */
  readonly frameRate: FrameRate | null;
  /** Of the modes `stateless` and `video`: the models that enhance frames, by name, or `off`. */
  readonly restore: string;
  readonly upscale: string;
  /** How movement is met, in every mode. */
  readonly reprojection: boolean;
  readonly prediction: PredictorName;
  readonly overscan: number | "auto";
  readonly depth: boolean;
  readonly surround: boolean;
  readonly segments: string;
  readonly repeats: string;
  readonly duration: string;
  readonly seed: string;
  /** For the mode `stateless`: every n-th shown frame is sampled; 0 samples none. */
  readonly stride: string;
  /** A person's input is ignored during the runs. */
  readonly locked: boolean;
  /** Save everything when the last run has ended. */
  readonly exportAtEnd: boolean;
}

/** As the store and the shaper have them. */
const LIMITS = {
  name: 100,
  rtt: { label: "Round trip", unit: "ms", min: 0, max: 120_000, whole: false },
  segments: { label: "Vary the movement", unit: "", min: 1, max: MAX_SEGMENTS, whole: true },
  seed: { label: "Seed", unit: "", min: 0, max: 2 ** 32 - 1, whole: true },
  repeats: { label: "Runs of each", unit: "", min: 1, max: MAX_REPEATS, whole: true },
  stride: { label: "Save every n-th frame", unit: "", min: 0, max: 100_000, whole: true },
  duration: { label: "Each run lasts", unit: "s", min: 1, max: 7200, whole: false },
} as const;

/** How long the camera stands at the first pose before it moves, in seconds: until controllers know the link. */
const WARM_UP = 3;

/** How long the chosen movement lasts, and the traces by their names, in milliseconds. */
export interface Lengths {
  readonly movement: number;
  readonly traces: Readonly<Record<string, number>>;
}

/** `present` is the current link, or the reason why it is unusable. */
export function parseDraft(
  draft: Draft,
  scene: string,
  present: Network | string,
  lengths: Lengths,
): { plan: ExperimentPlan } | { problems: readonly string[] } {
  const problems: string[] = [];
  const number = (name: Exclude<keyof typeof LIMITS, "name">): number => {
    const { label, unit, min, max, whole } = LIMITS[name];
    const typed = draft[name].trim().replace(",", ".");
    const value = typed === "" ? Number.NaN : Number(typed);
    const fits = value >= min && value <= max && (!whole || Number.isInteger(value));
    if (!fits) {
      const range = `${min} to ${max.toLocaleString("en")} ${unit}`.trim();
      problems.push(`“${label}” must be a ${whole ? "whole " : ""}number from ${range}.`);
    }
    return value;
  };
  const rtt = () => (draft.rtt.trim() === "" ? null : number("rtt"));
  const name = draft.name.trim();
  if (name === "") problems.push("The experiment needs a name.");
  if (name.length > LIMITS.name) problems.push(`The name must not be longer than ${LIMITS.name} characters.`);
  if (draft.movement === null) problems.push("Choose a movement.");
  const network = draft.trace === null ? present : { link: null, trace: draft.trace, rtt_ms: rtt() };
  if (typeof network === "string") problems.push(network);
  if (draft.modes.length === 0) problems.push("Choose a mode.");
  if (draft.modes.some(isPerView) && draft.profiles.length === 0) problems.push("Choose a controller.");
  const [count, repeats, duration_s, seed, sample_stride] = [
    number("segments"),
    number("repeats"),
    number("duration"),
    number("seed"),
    draft.modes.includes("stateless") ? number("stride") : 0,
  ];
  if (problems.length > 0 || typeof network === "string") return { problems };
  const parts = segments({
    count,
    length_s: duration_s,
    trace_s: network.trace === null ? null : (lengths.traces[network.trace] ?? 0) / 1000,
    movement_s: lengths.movement / 1000,
    seed,
  });
  if (typeof parts === "string") return { problems: [parts] };
  return {
    plan: {
      name,
      scene,
      movement: draft.movement ?? "",
      network,
      modes: draft.modes,
      profiles: draft.profiles,
      segments: parts,
      repeats,
      duration_s,
      warm_up_s: WARM_UP,
      sample_stride,
      dash_frame_rate: draft.frameRate,
      restore: draft.restore,
      upscale: draft.upscale,
      reprojection: draft.reprojection,
      prediction: draft.prediction,
      overscan: draft.overscan,
      depth: draft.depth,
      surround: draft.surround,
      seed,
      shuffled: true,
    },
  };
}

/** A list with an entry more or less; `order` says how entries follow one another. */
export function toggled<T>(list: readonly T[], entry: T, order: readonly T[]): readonly T[] {
  const chosen = list.includes(entry) ? list.filter((other) => other !== entry) : [...list, entry];
  return order.filter((other) => chosen.includes(other));
}
