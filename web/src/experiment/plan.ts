/** The plan of an experiment of the page, and its runs. Pure. */
import * as v from "valibot";
import { seeded } from "../abr/random";
import { CONTROLLER_NAMES, CONTROLLERS, type ControllerName } from "../abr/registry";
import { FRAME_RATES, type Preset } from "../dash/presets";
import { OFF } from "../enhance/model/enhancer";
import { PREDICTOR_NAMES } from "../predict/registry";
import type { Settings } from "../state/settings";
import { DASH, LINK_TERMS, LOCAL, MODE_NAMES, MODES, UNSHAPED as NO_LINK, PER_VIEW } from "../wire/run";
import type { LinkSetting } from "../wire/shaper";
import type { Configuration, RunRow } from "../wire/store";
import { type Segment, shuffled } from "./segments";

type AnyMode = Configuration["mode"];
/** A mode that new runs can have. */
export type RunMode = (typeof MODES)[number];

const isOneOf =
  <T extends AnyMode>(modes: readonly T[]) =>
  (mode: AnyMode): mode is T =>
    modes.some((one) => one === mode);
/** Whether the page requests each view, as chosen by a controller. */
export const isPerView = isOneOf(PER_VIEW);
export const isDash = isOneOf(DASH);
/** Whether a run needs the packager. */
export const isStreamed = (mode: RunMode) => mode === "webrtc" || isDash(mode);
/** Whether a run downloads the scene and draws it in this browser. */
export const isLocal = isOneOf(LOCAL);

const RUN_PRESETS = {
  "dash-typical": "typical",
  "dash-tuned": "tuned",
  "dash-edge": "edge",
} as const satisfies Record<(typeof DASH)[number], Preset>;

/** A controller's name, or a rung of the ladder, which then stays. */
export type Profile = ControllerName | number;

const Link = v.object({
  down_kbps: v.number(),
  up_kbps: v.number(),
  delay_ms: v.number(),
  jitter_ms: v.number(),
  loss_pct: v.number(),
}) satisfies v.GenericSchema<unknown, LinkSetting>;
const Network = v.object({
  /** A constant link. */
  link: v.nullable(Link),
  /** A trace of the shaper's, by name. */
  trace: v.nullable(v.string()),
  /** Replaces a trace's own delay. */
  rtt_ms: v.nullable(v.number()),
}) satisfies v.GenericSchema<unknown, Configuration["network"]>;
/** A trace of the shaper's, or the constant link that there is; neither where there is no shaper. */
export type Network = Readonly<v.InferOutput<typeof Network>>;

/** The current link, without a shaper. */
export const UNSHAPED: Network = { link: null, trace: null, rtt_ms: null };

export function constantLink({ down_kbps, up_kbps, delay_ms = 0, jitter_ms = 0, loss_pct = 0 }: LinkSetting): Network {
  return { link: { down_kbps, up_kbps, delay_ms, jitter_ms, loss_pct }, trace: null, rtt_ms: null };
}

/** A network in the form of `tigas compare --network`, such as `20mbit,20ms-rtt`; defaults are omitted. */
export function networkLabel({ link, trace, rtt_ms }: Network): string {
  if (link === null) return [trace ?? NO_LINK, ...(rtt_ms === null ? [] : [`${rtt_ms}ms-rtt`])].join();
  const terms = LINK_TERMS.map(({ field, ...term }) => ({ ...term, value: link[field] ?? 0 }));
  const said = terms.filter(({ value, usual }) => value !== usual);
  return said.map(({ value, scale, unit }) => `${Number((value / scale).toPrecision(6))}${unit}`).join();
}

export const MAX_REPEATS = 100;
export const MAX_SEGMENTS = 100;
/** A single part: trace and movement as they begin. */
export const FROM_THE_START: readonly Segment[] = [{ trace_s: 0, movement_s: 0 }];
const Plan = v.object({
  name: v.string(),
  scene: v.string(),
  /** The movement's name. */
  movement: v.string(),
  network: Network,
  modes: v.pipe(v.array(v.picklist(MODES)), v.readonly()),
  /** Of the modes `stateless` and `video`. */
  profiles: v.pipe(v.array(v.union([v.picklist(CONTROLLER_NAMES), v.number()])), v.readonly()),
  /** Runs of each controller, and of each DASH mode. */
  repeats: v.pipe(v.number(), v.integer(), v.maxValue(MAX_REPEATS)),
  /** Parts of trace and movement, which every controller and mode plays; plans of before have one. */
  segments: v.optional(
    v.pipe(v.array(v.object({ trace_s: v.number(), movement_s: v.number() })), v.minLength(1), v.readonly()),
    () => [...FROM_THE_START],
  ),
  /** Of the modes with DASH, in frames a second; null: the preset's own. */
  dash_frame_rate: v.optional(v.nullable(v.picklist(FRAME_RATES)), null),
  /** Of the modes `stateless` and `video`: the models that enhance each frame, by name, or `off`. */
  restore: v.optional(v.string(), OFF),
  upscale: v.optional(v.string(), OFF),
  /** Whether the newest frame is warped to each animation frame's pose, and the predictor of the requested poses. */
  reprojection: v.optional(v.boolean(), false),
  prediction: v.optional(v.picklist(PREDICTOR_NAMES), OFF),
  /** For reprojection: the margin of frames at each side, and whether there are depth and a surround. */
  overscan: v.optional(v.union([v.literal("auto"), v.pipe(v.number(), v.minValue(0), v.maxValue(0.5))]), "auto"),
  depth: v.optional(v.boolean(), true),
  surround: v.optional(v.boolean(), true),
  /** Of segments, the order of runs, and controllers' random numbers. */
  seed: v.optional(v.pipe(v.number(), v.integer(), v.minValue(0)), 1),
  /** Whether runs are made in random order. */
  shuffled: v.optional(v.boolean(), false),
  duration_s: v.number(),
  warm_up_s: v.number(),
  /** For the mode `stateless`: every n-th shown frame is sampled; 0 samples none. */
  sample_stride: v.optional(v.pipe(v.number(), v.integer(), v.minValue(0)), 0),
});
export type ExperimentPlan = Readonly<v.InferOutput<typeof Plan>>;

/** A stored plan; null if this page cannot have made it. */
export function readPlan(stored: unknown): ExperimentPlan | null {
  const read = v.safeParse(Plan, stored);
  return read.success ? read.output : null;
}

/** One run: its configuration before it is known how large the stage is. */
export interface PlannedRun extends Omit<Required<Configuration>, "width" | "height"> {
  readonly mode: RunMode;
  readonly network: Network & { readonly offset_s?: number };
  readonly profile: Profile;
  readonly prediction: ExperimentPlan["prediction"];
}

/** Values of `Configuration` without a controller: equal runs have equal configurations. */
const NO_CONTROLLER: Profile = "budget";
/** Values of `Configuration` for a stream. */
const OF_A_STREAM = { restore: OFF, upscale: OFF, sample_stride: 0 };
/** Assumed time of a run in addition to its warm-up and its movement: connecting, the first view, storing. In ms. */
const OVERHEAD = 5000;

/**
 * All runs, in order: every segment with every mode and controller once, then all of them again, so that changes over
 * time (another load, another hour) affect all of them. Within that, the order is shuffled by the seed.
 */
export function runsOf(plan: ExperimentPlan): PlannedRun[] {
  const { scene, movement, network, duration_s, warm_up_s, dash_frame_rate, restore, upscale, seed } = plan;
  const shared = {
    scene,
    movement,
    duration_s,
    warm_up_s,
    seed,
    capture_every_ms: 0,
    dash_frame_rate,
    dash_representation: null,
    reprojection: plan.reprojection,
    prediction: plan.prediction,
    overscan: plan.overscan,
    depth: plan.depth,
    surround: plan.surround,
  };
  const random = seeded(seed);
  const inOrder = <T>(values: readonly T[]) => (plan.shuffled ? shuffled(values, random) : values);
  const conditions = plan.modes.flatMap((mode) => {
    const [profiles, chosen] = isPerView(mode)
      ? [plan.profiles, { restore, upscale, sample_stride: mode === "stateless" ? plan.sample_stride : 0 }]
      : [[NO_CONTROLLER], OF_A_STREAM];
    return profiles.map((profile) => ({ mode, profile, ...chosen }));
  });
  const parts = plan.segments.map((begins, segment) => ({
    segment,
    network: network.trace === null ? network : { ...network, offset_s: begins.trace_s },
    movement_offset_s: begins.movement_s,
  }));
  return Array.from({ length: plan.repeats }, (_, repeat) =>
    inOrder(parts).flatMap((part) =>
      inOrder(conditions).map((condition) => ({ ...shared, ...part, ...condition, repeat })),
    ),
  ).flat();
}

/** The runs of a plan of which no complete one was stored, in their order. */
export function missingRuns(plan: ExperimentPlan, stored: readonly RunRow[]): PlannedRun[] {
  const keyOf = ({ mode, profile, segment = 0, repeat }: Configuration | PlannedRun) =>
    JSON.stringify([mode, profile, segment, repeat]);
  const complete = stored.filter(({ status }) => status === "complete");
  const made = new Set(complete.map(({ configuration }) => keyOf(configuration)));
  return runsOf(plan).filter((run) => !made.has(keyOf(run)));
}

/** Label of a run in the comparison: its controller, or its stream. Rungs have the ladder's names, if known. */
export function conditionLabel(
  { mode, profile }: Pick<PlannedRun, "profile"> & { readonly mode: AnyMode },
  ladder: readonly { readonly name: string }[] = [],
): string {
  if (!isPerView(mode)) return MODE_NAMES[mode];
  const chosen =
    typeof profile === "number"
      ? `Fixed: ${ladder[profile]?.name ?? `profile ${profile}`}`
      : CONTROLLERS[profile].title;
  return mode === "stateless" ? chosen : `${MODE_NAMES[mode]}, ${chosen}`;
}

/** A run's parameters from the viewer's settings. */
type Decisive =
  | "mode"
  | "profile"
  | "dash_frame_rate"
  | "restore"
  | "upscale"
  | "reprojection"
  | "prediction"
  | "overscan"
  | "depth"
  | "surround";

/** The viewer's settings before a run: only the picture, and no second request for a resting view. */
export function settingsFor({
  mode,
  profile,
  dash_frame_rate,
  restore,
  upscale,
  reprojection,
  prediction,
  overscan,
  depth,
  surround,
}: Pick<PlannedRun, Decisive>): Partial<Settings> {
  const motion = { reprojection, prediction, overscan, depth, surround };
  const shared = { sidebar: false, hud: false, refine: false, webp: false, restore, upscale, ...motion };
  if (isLocal(mode)) return { ...shared, mode: "stateless" }; // its download is recorded as well
  if (isDash(mode)) {
    return {
      ...shared,
      mode: "dash",
      dashPreset: RUN_PRESETS[mode],
      dashFrameRate: dash_frame_rate,
      dashRepresentation: null,
    };
  }
  if (mode === "webrtc") return { ...shared, mode, webrtcStream: "h264-30", dashRepresentation: null };
  const chosen = typeof profile === "number" ? ({ controller: "fixed", profile } as const) : { controller: profile };
  return { ...shared, mode, ...chosen };
}

/** Estimated time of runs in milliseconds; `overhead` is their measured time in addition to warm-up and movement. */
export function timeFor(plan: Pick<ExperimentPlan, "duration_s" | "warm_up_s">, runs: number, overhead = OVERHEAD) {
  return runs * ((plan.duration_s + plan.warm_up_s) * 1000 + overhead);
}
