/** What an experiment of the page is, and the runs that it consists of. Pure. */
import * as v from "valibot";
import { seeded } from "../abr/random";
import { CONTROLLER_NAMES, CONTROLLERS, type ControllerName } from "../abr/registry";
import { FRAME_RATES, type Preset } from "../dash/presets";
import { OFF } from "../enhance/model/enhancer";
import type { DownloadForm } from "../local/local-player";
import { PREDICTOR_NAMES } from "../predict/registry";
import type { Settings } from "../state/settings";
import type { LinkSetting } from "../wire/shaper";
import type { Configuration, RunRow } from "../wire/store";
import { type Segment, shuffled } from "./segments";

export const RUN_MODES = [
  "stateless",
  "video",
  "dash-typical",
  "dash-tuned",
  "dash-edge",
  "webrtc",
  "local-ply",
  "local-compressed",
] as const satisfies readonly Configuration["mode"][];
export type RunMode = Configuration["mode"];

export const RUN_MODE_NAMES: Readonly<Record<RunMode, string>> = {
  stateless: "Stateless",
  video: "Video",
  "dash-typical": "DASH, typical",
  "dash-tuned": "DASH, tuned",
  "dash-edge": "DASH, edge",
  webrtc: "WebRTC",
  "local-ply": "Local, PLY",
  "local-compressed": "Local, compressed",
};

/** Those in which the page asks for each view by itself, as a controller chooses. */
export type PerView = "stateless" | "video";
export const isPerView = (mode: RunMode): mode is PerView => mode === "stateless" || mode === "video";

const RUN_PRESETS = {
  "dash-typical": "typical",
  "dash-tuned": "tuned",
  "dash-edge": "edge",
} as const satisfies Partial<Record<RunMode, Preset>>;
const RUN_FORMS = {
  "local-ply": "ply",
  "local-compressed": "compressed",
} as const satisfies Partial<Record<RunMode, DownloadForm>>;

export const isDash = (mode: RunMode): mode is keyof typeof RUN_PRESETS => mode in RUN_PRESETS;
/** Whether a run needs the packager. */
export const isStreamed = (mode: RunMode) => mode === "webrtc" || isDash(mode);
/** Whether a run draws the scene in this browser. */
export const isLocal = (mode: RunMode): mode is keyof typeof RUN_FORMS => mode in RUN_FORMS;

/** What a run downloads to draw it in this browser; null in the other modes. */
export const downloadOf = (mode: RunMode): DownloadForm | null => (isLocal(mode) ? RUN_FORMS[mode] : null);

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
  /** Of a trace: in place of its own delay. */
  rtt_ms: v.nullable(v.number()),
}) satisfies v.GenericSchema<unknown, Configuration["network"]>;
/** A trace of the shaper's, or the constant link that there is; neither where there is no shaper. */
export type Network = Readonly<v.InferOutput<typeof Network>>;

/** The link as it is, where there is no shaper. */
export const UNSHAPED: Network = { link: null, trace: null, rtt_ms: null };

export function constantLink({ down_kbps, up_kbps, delay_ms = 0, jitter_ms = 0, loss_pct = 0 }: LinkSetting): Network {
  return { link: { down_kbps, up_kbps, delay_ms, jitter_ms, loss_pct }, trace: null, rtt_ms: null };
}

/** A network as `tigas compare --network` reads it, such as `20mbit,20ms-rtt`: what is usual goes unsaid. */
export function networkLabel({ link, trace, rtt_ms }: Network): string {
  if (link === null) return [trace ?? "unshaped", ...(rtt_ms === null ? [] : [`${rtt_ms}ms-rtt`])].join();
  const parts = [
    { value: link.down_kbps / 1000, unit: "mbit", usual: null },
    { value: link.up_kbps / 1000, unit: "mbit-up", usual: 10 },
    { value: link.jitter_ms, unit: "ms-jitter", usual: 0 },
    { value: link.loss_pct, unit: "%-loss", usual: 0 },
    { value: link.delay_ms * 2, unit: "ms-rtt", usual: 0 },
  ];
  const said = parts.filter(({ value, usual }) => value !== usual);
  return said.map(({ value, unit }) => `${Number(value.toFixed(3))}${unit}`).join();
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
  modes: v.pipe(v.array(v.picklist(RUN_MODES)), v.readonly()),
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
  /** Whether the newest frame is turned to each animation frame's pose, and what predicts the poses that frames are asked for. */
  reprojection: v.optional(v.boolean(), false),
  prediction: v.optional(v.picklist(PREDICTOR_NAMES), OFF),
  /** Of reprojection: how much more frames show at each side, and whether they come with a depth, and a surround beside them. */
  overscan: v.optional(v.union([v.literal("auto"), v.pipe(v.number(), v.minValue(0), v.maxValue(0.5))]), "auto"),
  depth: v.optional(v.boolean(), true),
  surround: v.optional(v.boolean(), true),
  /** Of segments, the order of runs, and controllers' random numbers. */
  seed: v.optional(v.pipe(v.number(), v.integer(), v.minValue(0)), 1),
  /** Whether runs are made in random order. */
  shuffled: v.optional(v.boolean(), false),
  duration_s: v.number(),
  warm_up_s: v.number(),
  /** Of the mode `stateless`: every so many shown frames, one is sampled; 0 samples none. */
  sample_stride: v.optional(v.pipe(v.number(), v.integer(), v.minValue(0)), 0),
});
export type ExperimentPlan = Readonly<v.InferOutput<typeof Plan>>;

/** A plan as the store has it; null if it is none of this page's. */
export function readPlan(stored: unknown): ExperimentPlan | null {
  const read = v.safeParse(Plan, stored);
  return read.success ? read.output : null;
}

/** One run: its configuration before it is known how large the stage is. */
export interface PlannedRun extends Omit<Required<Configuration>, "width" | "height"> {
  readonly network: Network & { readonly offset_s?: number };
  readonly profile: Profile;
  readonly prediction: ExperimentPlan["prediction"];
}

/** What `Configuration` has where no controller chooses: equal runs have equal configurations. */
const NO_CONTROLLER: Profile = "budget";
/** What a stream has not. */
const OF_A_STREAM = { restore: OFF, upscale: OFF, sample_stride: 0 };
/** What a run takes beside its warm-up and its movement, before any was made: connecting, the first view, storing. In ms. */
const OVERHEAD = 5000;

/**
 * All runs, in their order: every segment with every mode and controller once, then all of them again, so that whatever changes in
 * the course of an experiment (another load, another hour) falls on all of them. Within that, the seed shuffles.
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

/** What a run compares: its controller, or its way to stream. Rungs have the ladder's names, where it is known. */
export function conditionLabel(
  { mode, profile }: Pick<PlannedRun, "mode" | "profile">,
  ladder: readonly { readonly name: string }[] = [],
): string {
  if (!isPerView(mode)) return RUN_MODE_NAMES[mode];
  const chosen =
    typeof profile === "number"
      ? `Fixed: ${ladder[profile]?.name ?? `profile ${profile}`}`
      : CONTROLLERS[profile].title;
  return mode === "stateless" ? chosen : `${RUN_MODE_NAMES[mode]}, ${chosen}`;
}

/** What of a run the viewer's settings say. */
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

/** The viewer's settings before a run: nothing beside the picture, and no second request for a view that stands still. */
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
  if (isLocal(mode)) return { ...shared, mode: "stateless" }; // its download is part of what is recorded
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

/** How long so many runs take, in milliseconds; `overhead` is what they were seen to take beside warm-up and movement. */
export function timeFor(plan: Pick<ExperimentPlan, "duration_s" | "warm_up_s">, runs: number, overhead = OVERHEAD) {
  return runs * ((plan.duration_s + plan.warm_up_s) * 1000 + overhead);
}
