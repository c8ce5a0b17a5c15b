/** The experiment file that the page's form writes (`docs/experiments.md`). Pure. */

import { DASH, type MODE_NAMES, PER_VIEW } from "#client/wire/run";
import type { Configuration } from "#client/wire/store";
import { OFF } from "#viewer/enhance/model/enhancer";
import type { Settings } from "#viewer/state/settings";

export type RunMode = keyof typeof MODE_NAMES & Configuration["mode"];
/** A controller's name, or a fixed rung of the ladder. */
export type Profile = string | number;

/** The form's content; numbers are as typed. */
export interface Draft {
  readonly name: string;
  /** Key of the movement; null if none is chosen. */
  readonly movement: string | null;
  /** A trace of the shaper's; null for the current link. */
  readonly trace: string | null;
  readonly rtt: string;
  readonly modes: readonly RunMode[];
  readonly controllers: readonly Profile[];
  readonly reprojection: boolean;
  readonly prediction: Settings["prediction"];
  readonly segments: string;
  readonly repeats: string;
  readonly duration: string;
  readonly stride: string;
}

export interface Inputs {
  readonly scene: string;
  /** File name. */
  readonly movement: string;
  /** The current link's label. */
  readonly present: string;
  /** The viewer's settings, for values that the form does not ask for. */
  readonly settings: Pick<Settings, "restore" | "upscale" | "overscan" | "depth" | "surround">;
  readonly viewport: { readonly width: number; readonly height: number };
}

const includes = (modes: readonly string[], mode: string) => modes.includes(mode);
/** Whether the page requests each view, as chosen by a controller. */
export const isPerView = (mode: RunMode) => includes(PER_VIEW, mode);
/** Whether a run needs the packager. */
export const isStreamed = (mode: RunMode) => mode === "webrtc" || includes(DASH, mode);

/** TOML; its strings, numbers and lists are written as in JSON. */
export function experimentFile(draft: Draft, { scene, movement, present, settings, viewport }: Inputs): string {
  const { trace, rtt, reprojection } = draft;
  const perView = draft.modes.some(isPerView);
  const values = {
    name: draft.name,
    scenes: [scene],
    movements: [movement],
    networks: [trace ?? present],
    rtts_ms: trace !== null && rtt.trim() !== "" ? [number(rtt)] : undefined,
    modes: draft.modes,
    controllers: perView ? draft.controllers : undefined,
    restore: perView && settings.restore !== OFF ? settings.restore : undefined,
    upscale: perView && settings.upscale !== OFF ? settings.upscale : undefined,
    reprojection,
    prediction: draft.prediction,
    overscan: reprojection ? settings.overscan : undefined,
    depth: reprojection ? settings.depth : undefined,
    surround: reprojection ? settings.surround : undefined,
    segments: number(draft.segments),
    repeats: number(draft.repeats),
    duration_s: number(draft.duration),
    viewport: `${viewport.width}x${viewport.height}`,
    seed: 1,
    sample_stride: number(draft.stride),
  };
  return Object.entries(values)
    .filter(([, value]) => value !== undefined)
    .map(([key, value]) => `${key} = ${JSON.stringify(value)}\n`)
    .join("");
}

/** Adds an entry to a list or removes it; the result is sorted as in `order`. */
export function toggled<T>(list: readonly T[], entry: T, order: readonly T[]): readonly T[] {
  const chosen = list.includes(entry) ? list.filter((other) => other !== entry) : [...list, entry];
  return order.filter((other) => chosen.includes(other));
}

/** A typed number; anything else stays text, which the store refuses with a message. */
function number(typed: string): number | string {
  const value = Number(typed);
  return typed.trim() === "" || !Number.isFinite(value) ? typed : value;
}
