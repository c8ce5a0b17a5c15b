/** The user's settings, stored in the browser. Invalid stored values are replaced by their defaults. */

import { CONTROLLER_NAMES, CONTROLLERS } from "#client/abr/registry";
import { DASH_TRANSPORTS, SIDE_MODES, SOURCES, USUAL_SIDES } from "#client/wire/run";
import { type DashSettings, FRAME_RATES, tuned } from "../dash/presets";
import { type Kind, OFF } from "../enhance/model/enhancer";
import { enhancersOf } from "../enhance/registry";
import { PREDICTOR_NAMES, PREDICTORS } from "../predict/registry";
import { CODEC_NAMES, WEBRTC_PLANS, WEBRTC_STREAMS } from "../webrtc/presets";
import {
  BOOLEAN,
  either,
  nullable,
  numberWithin,
  oneOf,
  record,
  type Schema,
  type ValueOf,
  wholeWithin,
} from "./schema";

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

interface About {
  readonly label?: string;
  readonly help?: string;
  /** Labels of its values, in the order in which they are offered. */
  readonly options?: Readonly<Record<string, string>>;
  /** Unit and range of a number. */
  readonly unit?: string;
  readonly range?: readonly [min: number, max: number];
  /** Part of a link to a view, because it affects the picture. */
  readonly linked?: true;
  /** Affects measurements, so it must not change during a run of an experiment. */
  readonly recorded?: true;
}

/** `usual` is the default, which also replaces invalid stored values. */
function setting<T, const More extends About>(schema: Schema<T>, usual: NoInfer<T>, about: More) {
  return { schema, usual, ...about };
}

const toggle = <const More extends About>(usual: boolean, about: More) => setting(BOOLEAN, usual, about);

/** A setting with one of several labelled values. */
function choice<Options extends Readonly<Record<string, string>>, const More extends About>(
  options: Options,
  usual: NoInfer<keyof Options & string>,
  about: More,
) {
  return setting(oneOf(Object.keys(options) as (keyof Options & string)[]), usual, { ...about, options });
}

function number<const More extends About>(min: number, max: number, usual: number, about: More) {
  return setting(numberWithin(min, max), usual, { ...about, range: [min, max] });
}

function whole<const More extends About>(min: number, max: number, usual: number, about: More) {
  return setting(wholeWithin(min, max), usual, { ...about, range: [min, max] });
}

const LAST_RUNG = 255;
const KBPS = wholeWithin(50, 100_000);

/** The names with their labels. */
const labelled = <Name extends string>(names: readonly Name[], label: (name: Name) => string) =>
  Object.fromEntries(names.map((name) => [name, label(name)])) as Record<Name, string>;

const models = (kind: Kind): Record<string, string> => ({
  [OFF]: "Off",
  ...Object.fromEntries(enhancersOf(kind).map(({ name, label }) => [name, label])),
});

/** Every setting: its values, its label and help, and whether it is part of links and of experiments. */
export const SETTINGS = {
  theme: choice({ system: "System", light: "Light", dark: "Dark" }, "system", { label: "Theme" }),
  transport: choice(
    {
      auto: "Automatic",
      "webtransport-streams": "WebTransport streams",
      "webtransport-datagrams": "WebTransport datagrams",
      fetch: "HTTP fetch",
    },
    "auto",
    { label: "Transport", recorded: true },
  ),
  mode: setting(oneOf(MODES), USUAL_SIDES[0], { linked: true, recorded: true }),
  /** The two pictures of a comparison. */
  left: setting(oneOf(SIDE_MODES), USUAL_SIDES[0], { label: "Left", linked: true, recorded: true }),
  right: setting(oneOf(SIDE_MODES), USUAL_SIDES[1], { label: "Right", linked: true, recorded: true }),
  /** Constraint shared by both sides: a rung of the ladder, or a rate in kbit/s. */
  lock: choice({ off: "Nothing", resolution: "Resolution", bitrate: "Bit rate" }, "off", {
    label: "Keep the same",
    linked: true,
    recorded: true,
  }),
  lockRung: whole(0, LAST_RUNG, 0, { label: "Profile", linked: true, recorded: true }),
  lockKbps: whole(50, 100_000, 3000, { label: "Limit", unit: "kbit/s", linked: true, recorded: true }),
  dashPreset: choice({ typical: "Typical", tuned: "Tuned", edge: "Edge", custom: "Custom" }, "tuned", {
    label: "DASH stream",
    linked: true,
    recorded: true,
  }),
  /** Frames per second; null: the preset's own. */
  dashFrameRate: setting(nullable(oneOf(FRAME_RATES)), null, { label: "Frame rate", recorded: true }),
  dashTransport: choice(DASH_TRANSPORTS, "tcp", { label: "Segment transport", recorded: true }),
  /** A single representation of a stream, for measurements; null for all that the packager offers. */
  dashRepresentation: setting(nullable(record({ rung: wholeWithin(0, LAST_RUNG), bitrate_kbps: KBPS })), null, {
    recorded: true,
  }),
  /** Parameters of the preset "custom". */
  dashCustom: setting(
    record({
      segment_s: numberWithin(0.2, 10),
      frames_per_chunk: wholeWithin(1, 600),
      target_latency_ms: wholeWithin(50, 10_000),
      frame_rate: wholeWithin(1, 60),
    }),
    tuned(30),
    { recorded: true },
  ),
  webrtcStream: choice(
    labelled(WEBRTC_STREAMS, (name) => `${CODEC_NAMES[WEBRTC_PLANS[name].codec]}, ${WEBRTC_PLANS[name].frameRate}/s`),
    "h264-30",
    { label: "WebRTC stream", linked: true, recorded: true },
  ),
  /** What the mode "local" downloads; a scene without levels of detail is downloaded as a whole. */
  localForm: choice({ streamed: "Levels of detail", compressed: "Whole scene" }, "streamed", {
    label: "Download",
    linked: true,
    recorded: true,
  }),
  /** Controller of the ladder's rung; "fixed": chosen by the user. */
  controller: choice(
    {
      ...labelled(CONTROLLER_NAMES, (name) => `Automatic: ${CONTROLLERS[name].title}`),
      fixed: "Fixed profile",
    },
    "seen",
    { label: "Adaptation", linked: true, recorded: true },
  ),
  profile: whole(0, LAST_RUNG, 0, { label: "Profile", linked: true, recorded: true }),
  /** When the camera stands still, requests the view again at the best rung. */
  refine: toggle(true, { label: "Sharpen when you stop", linked: true, recorded: true }),
  webp: toggle(true, {
    label: "WebP on slow links",
    help: "Smaller pictures at the same quality, which take the server a few milliseconds longer",
    linked: true,
    recorded: true,
  }),
  /** The models that enhance each frame, by name, or `off`. */
  restore: choice(models("restore"), OFF, { label: "Restore", linked: true, recorded: true }),
  upscale: choice(models("upscale"), OFF, { label: "Upscale", linked: true, recorded: true }),
  reprojection: toggle(true, {
    label: "Smooth turning (reprojection)",
    help: "Turns the newest frame to the current view on every screen refresh",
    linked: true,
    recorded: true,
  }),
  prediction: choice(
    labelled(PREDICTOR_NAMES, (name) => PREDICTORS[name].title),
    "velocity",
    {
      label: "Prediction",
      help: "Requests the view from the predicted camera position",
      linked: true,
      recorded: true,
    },
  ),
  /** As a share of the viewport at each side. */
  overscan: setting(either(oneOf(["auto"]), numberWithin(0, 0.5)), "auto", {
    label: "Overscan",
    help: "How far each frame extends beyond the view, as a share of its size",
    linked: true,
    recorded: true,
  }),
  depth: toggle(true, {
    label: "Use depth",
    help: "Uses a coarse depth map so that near objects shift more than distant ones as you walk",
    linked: true,
    recorded: true,
  }),
  surround: toggle(true, {
    label: "Fill the edges on fast turns",
    help: "Small pictures of every direction fill the areas that a quick turn would leave dark",
    linked: true,
    recorded: true,
  }),
  drag: choice({ look: "Look around", orbit: "Orbit" }, "look", { label: "Drag to", linked: true }),
  turnSpeed: number(1, 720, 60, { label: "Turn", unit: "°/s" }),
  sidebar: toggle(false, {}),
  hud: toggle(true, {}),
  /** All measurements, or one line; null shows all while the lab is open, if there is room. */
  hudDetails: setting(nullable(BOOLEAN), null, {}),
  /** Whether to explain over the picture how to move, until the first movement. */
  hint: toggle(true, {}),
  shortcuts: toggle(true, {
    label: "Single-key shortcuts",
    help: "When off, letter keys only move the camera, and only while the picture has the focus",
  }),
};

export type Settings = { [Name in keyof typeof SETTINGS]: ValueOf<(typeof SETTINGS)[Name]["schema"]> };
type NamesWith<Flag> = {
  [Name in keyof typeof SETTINGS]: (typeof SETTINGS)[Name] extends Flag ? Name : never;
}[keyof typeof SETTINGS];
export type LinkedName = NamesWith<{ readonly linked: true }>;

export interface SideSettings
  extends Omit<Settings, "mode" | "dashRepresentation">,
    Pick<DashSettings, "dashRepresentation"> {
  readonly mode: SourceName;
  /** Limit in kbit/s; unlimited if absent. */
  readonly bitrateKbps?: number;
}

const NAMES = Object.keys(SETTINGS) as (keyof Settings)[];
const about = (name: keyof Settings): About => SETTINGS[name] as About;

/** Reads settings from outside; invalid values are replaced by the defaults. */
function parse(stored: Readonly<Record<string, unknown>>): Settings {
  const read = (name: keyof Settings) => {
    const { schema, usual }: { schema: Schema<unknown>; usual: unknown } = SETTINGS[name];
    return schema.accepts(stored[name]) ? stored[name] : usual;
  };
  return Object.fromEntries(NAMES.map((name) => [name, read(name)])) as Settings;
}

export const DEFAULT_SETTINGS: Settings = parse({});

/** Settings that affect the view, which links may contain. */
export const LINKED = NAMES.filter((name) => about(name).linked) as readonly LinkedName[];

/** The settings that affect measurements, as text for comparison. */
export function recorded(settings: Settings): string {
  return JSON.stringify(NAMES.filter((name) => about(name).recorded).map((name) => settings[name]));
}

/** The values that a setting may have in a link; null if they cannot be listed. */
export function choicesOf(name: LinkedName): readonly string[] | null {
  return SETTINGS[name].schema.choices ?? null;
}

/** Parses a setting's value, including `on` and `off`; undefined if invalid. */
export function settingOf<Name extends LinkedName>(name: Name, text: string): Settings[Name] | undefined {
  const candidates = [
    text,
    ...(text === "on" || text === "off" ? [text === "on"] : []),
    ...(text ? [Number(text)] : []),
  ];
  const read = (value: unknown) => parse({ [name]: value })[name];
  return candidates.find((value): value is Settings[Name] => read(value) === value);
}

/** Returns the same settings if each is known and has a valid value. Throws otherwise. */
export function validSettings(settings: Settings): Settings {
  const unknown = Object.keys(settings).find((name) => !Object.hasOwn(SETTINGS, name));
  if (unknown !== undefined) throw new Error(`unknown setting ${unknown}`);
  const valid = parse({ ...settings });
  // An invalid value would be replaced by the default.
  const wrong = NAMES.find((name) => JSON.stringify(valid[name]) !== JSON.stringify(settings[name]));
  if (wrong !== undefined) throw new Error(`${wrong} has an invalid value`);
  return valid;
}

const KEY = "tigas.settings";

/** Returns the part of localStorage that is used; some browsers throw on any access, even to the name, as in frames of other sites. */
export type Disk = () => Pick<Storage, "getItem" | "setItem">;

export function loadSettings(disk: Disk): Settings {
  try {
    return parse(JSON.parse(disk().getItem(KEY) ?? "{}"));
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
