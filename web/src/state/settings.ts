/** What a person chose, kept in the browser. Anything there that does not make sense is replaced by its default. */
import * as v from "valibot";
import { CONTROLLER_NAMES } from "../abr/registry";
import { FRAME_RATES, PRESETS, tuned } from "../dash/presets";
import { OFF } from "../enhance/model/enhancer";
import { enhancersOf } from "../enhance/registry";
import { PREDICTOR_NAMES } from "../predict/registry";
import { WEBRTC_STREAMS } from "../webrtc/presets";
import type { SceneDownload } from "../wire/render";

export const MODES = ["stateless", "video", "dash", "webrtc", "side-by-side", "local"] as const;
export type Mode = (typeof MODES)[number];

/** Whether a stream of the packager's is shown; of `side-by-side`, each side has a mode of its own (`sides.ts`). */
export const isStreamed = (mode: Mode): mode is "dash" | "webrtc" => mode === "dash" || mode === "webrtc";
/** Whether the page asks for each view by itself. */
export const isPerView = (mode: Mode) => mode === "stateless" || mode === "video";

/** Files of a scene that the mode `local` can download. */
export const LOCAL_FORMS = ["ply", "compressed"] as const satisfies readonly SceneDownload["form"][];

/** What a side may be when two are compared: a mode, and which stream or file it has. */
export const SIDE_MODES = [
  "stateless",
  "video",
  ...PRESETS.map((preset) => `dash-${preset}` as const),
  "webrtc",
  ...LOCAL_FORMS.map((form) => `local-${form}` as const),
] as const;
export type SideMode = (typeof SIDE_MODES)[number];

export const LOCKS = ["off", "resolution", "bitrate"] as const;
export type SideLock = (typeof LOCKS)[number];

const Settings = v.object({
  theme: v.fallback(v.picklist(["system", "light", "dark"]), "system"),
  transport: v.fallback(v.picklist(["auto", "webtransport-streams", "webtransport-datagrams", "fetch"]), "auto"),
  /**
   * What shows the scene: one JPEG per pose, one frame of a video per pose, a stream over DASH or WebRTC, any two beside each other, or this
   * browser, which downloads the scene.
   */
  mode: v.fallback(v.picklist(MODES), "stateless"),
  /** What is compared side by side. */
  left: v.fallback(v.picklist(SIDE_MODES), "stateless"),
  right: v.fallback(v.picklist(SIDE_MODES), "dash-tuned"),
  /** What both sides have in common then: a rung of the ladder, or how many kbit/s they may take. */
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
  /** What the preset "custom" means. */
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
  localForm: v.fallback(v.picklist(LOCAL_FORMS), "compressed"),
  /** What chooses the ladder's rung; "fixed": the person does. */
  controller: v.fallback(v.picklist(["fixed", ...CONTROLLER_NAMES]), "budget"),
  /** The rung that a person chose. */
  profile: v.fallback(v.pipe(v.number(), v.integer(), v.minValue(0), v.maxValue(255)), 0),
  /** When the camera stands still, ask for the view once more at the best rung. */
  refine: v.fallback(v.boolean(), true),
  /** Whether pictures come as WebP where that is faster. */
  webp: v.fallback(v.boolean(), true),
  /** The models that enhance each frame before it is shown, by name, or `off`. */
  restore: v.fallback(v.picklist([OFF, ...enhancersOf("restore").map(({ name }) => name)]), OFF),
  upscale: v.fallback(v.picklist([OFF, ...enhancersOf("upscale").map(({ name }) => name)]), OFF),
  /** Whether the newest frame is turned to the pose of each animation frame. */
  reprojection: v.fallback(v.boolean(), true),
  /** What predicts the poses that frames are asked for, or `off`. */
  prediction: v.fallback(v.picklist(PREDICTOR_NAMES), "auto"),
  /** Of reprojection: how much more frames show at each side, as a share of the viewport. */
  overscan: v.fallback(v.union([v.literal("auto"), v.pipe(v.number(), v.minValue(0), v.maxValue(0.5))]), "auto"),
  /** Of reprojection: whether frames are asked for with a coarse depth. */
  depth: v.fallback(v.boolean(), true),
  /** Of reprojection: whether small pictures of all directions are asked for, too, beside the view. */
  surround: v.fallback(v.boolean(), true),
  /** What dragging does: the picture follows the pointer, or what is looked at turns. */
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

export const DEFAULT_SETTINGS: Settings = v.parse(Settings, {});

/** Those that links may name: they decide what is seen. */
export const LINKED = [
  ...(["mode", "left", "right", "lock", "lockRung", "lockKbps"] as const),
  ...(["dashPreset", "webrtcStream", "localForm", "controller", "profile", "refine", "webp"] as const),
  ...(["restore", "upscale", "reprojection", "prediction", "overscan", "depth", "surround", "drag"] as const),
] satisfies readonly (keyof Settings)[];

/** What a text means as a setting's value, `on` and `off` among them; undefined if that makes no sense. */
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

/** The part of localStorage that is used; some browsers throw on any access. */
export type Store = Pick<Storage, "getItem" | "setItem">;

export function loadSettings(store: Store): Settings {
  try {
    const result = v.safeParse(Settings, JSON.parse(store.getItem(KEY) ?? "{}"));
    return result.success ? result.output : DEFAULT_SETTINGS;
  } catch {
    return DEFAULT_SETTINGS;
  }
}

export function saveSettings(store: Store, settings: Settings): void {
  try {
    store.setItem(KEY, JSON.stringify(settings));
  } catch {
    // a private window or a full disk: the settings last as long as the page
  }
}
