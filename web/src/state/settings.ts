/** The user's settings, stored in the browser. Invalid stored values are replaced by their defaults. */
import * as v from "valibot";
import { CONTROLLER_NAMES } from "../abr/registry";
import { type DashSettings, FRAME_RATES, PRESETS, tuned } from "../dash/presets";
import { OFF } from "../enhance/model/enhancer";
import { enhancersOf } from "../enhance/registry";
import { PREDICTOR_NAMES } from "../predict/registry";
import { WEBRTC_STREAMS } from "../webrtc/presets";
import { SIDE_MODES, SOURCES, USUAL_SIDES } from "../wire/run";

/** A mode that shows one picture. */
export type SourceName = (typeof SOURCES)[number];
/** Two pictures, each with its own mode. */
export const COMPARED = "side-by-side";
export const MODES = [...SOURCES, COMPARED] as const;
export type Mode = (typeof MODES)[number];
/** Choices for a side of a comparison: a mode, and the preset of a stream. */
export type SideMode = (typeof SIDE_MODES)[number];
export const PLACES = ["left", "right"] as const;
export type Place = (typeof PLACES)[number];

export const LOCKS = ["off", "resolution", "bitrate"] as const;
export type SideLock = (typeof LOCKS)[number];

const Settings = v.object({
  theme: v.fallback(v.picklist(["system", "light", "dark"]), "system"),
  transport: v.fallback(v.picklist(["auto", "webtransport-streams", "webtransport-datagrams", "fetch"]), "auto"),
  mode: v.fallback(v.picklist(MODES), USUAL_SIDES[0]),
  /** The two pictures of a comparison. */
  left: v.fallback(v.picklist(SIDE_MODES), USUAL_SIDES[0]),
  right: v.fallback(v.picklist(SIDE_MODES), USUAL_SIDES[1]),
  /** Constraint shared by both sides: a rung of the ladder, or a rate in kbit/s. */
  lock: v.fallback(v.picklist(LOCKS), "off"),
  lockRung: v.fallback(v.pipe(v.number(), v.integer(), v.minValue(0), v.maxValue(255)), 0),
  lockKbps: v.fallback(v.pipe(v.number(), v.integer(), v.minValue(50), v.maxValue(100_000)), 3000),
  dashPreset: v.fallback(v.picklist(PRESETS), "tuned"),
  /** Frames a second; null: the preset's own. */
  dashFrameRate: v.fallback(v.nullable(v.picklist(FRAME_RATES)), null),
  /** A single DASH representation, for measurements; null: all that the packager offers. */
  dashRepresentation: v.fallback(
    v.nullable(
      v.object({
        rung: v.pipe(v.number(), v.integer(), v.minValue(0), v.maxValue(255)),
        bitrate_kbps: v.pipe(v.number(), v.integer(), v.minValue(50), v.maxValue(100_000)),
      }),
    ),
    null,
  ),
  /** Parameters of the preset "custom". */
  dashCustom: v.fallback(
    v.object({
      segment_s: v.pipe(v.number(), v.minValue(0.2), v.maxValue(10)),
      frames_per_chunk: v.pipe(v.number(), v.integer(), v.minValue(1), v.maxValue(600)),
      target_latency_ms: v.pipe(v.number(), v.integer(), v.minValue(50), v.maxValue(10_000)),
      frame_rate: v.pipe(v.number(), v.integer(), v.minValue(1), v.maxValue(60)),
    }),
    tuned(30),
  ),
  webrtcStream: v.fallback(v.picklist(WEBRTC_STREAMS), "h264-30"),
  /** Controller of the ladder's rung; "fixed": chosen by the user. */
  controller: v.fallback(v.picklist(["fixed", ...CONTROLLER_NAMES]), "budget"),
  /** The rung that a person chose. */
  profile: v.fallback(v.pipe(v.number(), v.integer(), v.minValue(0), v.maxValue(255)), 0),
  /** When the camera stands still, ask for the view once more at the best rung. */
  refine: v.fallback(v.boolean(), true),
  /** Whether pictures come as WebP where that is faster. */
  webp: v.fallback(v.boolean(), true),
  /** The models that enhance each frame, by name, or `off`. */
  restore: v.fallback(v.picklist([OFF, ...enhancersOf("restore").map(({ name }) => name)]), OFF),
  upscale: v.fallback(v.picklist([OFF, ...enhancersOf("upscale").map(({ name }) => name)]), OFF),
  /** Whether the newest frame is turned to the pose of each animation frame. */
  reprojection: v.fallback(v.boolean(), true),
  /** Predictor of the requested poses, or `off`. */
  prediction: v.fallback(v.picklist(PREDICTOR_NAMES), "velocity"),
  /** Of reprojection: how much more frames show at each side, as a share of the viewport. */
  overscan: v.fallback(v.union([v.literal("auto"), v.pipe(v.number(), v.minValue(0), v.maxValue(0.5))]), "auto"),
  /** For reprojection: whether frames include a coarse depth. */
  depth: v.fallback(v.boolean(), true),
  /** For reprojection: whether small pictures of all directions are requested as well. */
  surround: v.fallback(v.boolean(), true),
  /** Effect of dragging: the picture follows the pointer, or the focus turns. */
  drag: v.fallback(v.picklist(["look", "orbit"]), "look"),
  /** Degrees a second. */
  turnSpeed: v.fallback(v.pipe(v.number(), v.minValue(1), v.maxValue(720)), 60),
  /** Null: open where there is room. */
  sidebar: v.fallback(v.nullable(v.boolean()), null),
  hud: v.fallback(v.boolean(), true),
  /** All of the HUD's numbers, or the most important ones; null: all where there is room. */
  hudDetails: v.fallback(v.nullable(v.boolean()), null),
});

export type Settings = v.InferOutput<typeof Settings>;

/** Settings of one picture on the stage. */
export interface SideSettings
  extends Omit<Settings, "mode" | "dashRepresentation">,
    Pick<DashSettings, "dashRepresentation"> {
  readonly mode: SourceName;
  /** How many kbit/s it may take; without it, as many as it likes. */
  readonly bitrateKbps?: number;
}

export const DEFAULT_SETTINGS: Settings = v.parse(Settings, {});

/** Settings that links may contain: those that affect the view. */
export const LINKED = [
  ...(["mode", "left", "right", "lock", "lockRung", "lockKbps"] as const),
  ...(["dashPreset", "webrtcStream", "controller", "profile", "refine", "webp"] as const),
  ...(["restore", "upscale", "reprojection", "prediction", "overscan", "depth", "surround", "drag"] as const),
] satisfies readonly (keyof Settings)[];

/** Parses a setting's value, including `on` and `off`; undefined if invalid. */
export function settingOf<Name extends (typeof LINKED)[number]>(name: Name, text: string): Settings[Name] | undefined {
  const candidates = [
    text,
    ...(text === "on" || text === "off" ? [text === "on"] : []),
    ...(text ? [Number(text)] : []),
  ];
  return candidates.map((value) => valid(name, value)).find((value) => value !== undefined);
}

function valid<Name extends keyof Settings>(name: Name, value: unknown): Settings[Name] | undefined {
  const read = v.parse(Settings, { [name]: value })[name];
  return read === value ? read : undefined;
}

const KEY = "tigas.settings";

/** The same settings, if each has a value that it may have. Throws otherwise. */
export function validSettings(settings: Settings): Settings {
  const valid = v.parse(Settings, settings);
  for (const name of Object.keys(valid) as (keyof Settings)[]) {
    // A value that makes no sense would be replaced by its default.
    if (JSON.stringify(valid[name]) !== JSON.stringify(settings[name])) throw new Error(`${name} cannot be that`);
  }
  return valid;
}

/** Gives the part of localStorage that is used; some browsers throw on any access, even to the name, as in frames of other sites. */
export type Disk = () => Pick<Storage, "getItem" | "setItem">;

export function loadSettings(disk: Disk): Settings {
  try {
    const result = v.safeParse(Settings, JSON.parse(disk().getItem(KEY) ?? "{}"));
    return result.success ? result.output : DEFAULT_SETTINGS;
  } catch {
    return DEFAULT_SETTINGS;
  }
}

export function saveSettings(disk: Disk, settings: Settings): void {
  try {
    disk().setItem(KEY, JSON.stringify(settings));
  } catch {
    // a private window or a full disk: the settings last as long as the page
  }
}
