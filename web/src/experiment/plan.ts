/** What an experiment of the page is, and the runs that it consists of. Pure. */
import { CONTROLLERS, type ControllerName } from "../abr/registry";
import type { Settings } from "../state/settings";
import type { Configuration } from "../store-wire";

export const RUN_MODES = [
  "stateless",
  "dash-typical",
  "dash-tuned",
] as const satisfies readonly Configuration["mode"][];
export type RunMode = Configuration["mode"];

export const RUN_MODE_NAMES: Readonly<Record<RunMode, string>> = {
  stateless: "Stateless",
  "dash-typical": "DASH, typical",
  "dash-tuned": "DASH, tuned",
};

/** A controller's name, or a rung of the ladder, which then stays. */
export type Profile = ControllerName | number;

/** The link as it is, or a trace of the shaper's, at another round trip than its own if one is given. */
export interface Network {
  readonly trace: string | null;
  readonly rtt_ms: number | null;
}

export interface ExperimentPlan {
  readonly name: string;
  readonly scene: string;
  /** The movement's name. */
  readonly movement: string;
  readonly network: Network;
  readonly modes: readonly RunMode[];
  /** Of the mode `stateless`. */
  readonly profiles: readonly Profile[];
  /** Runs of each controller, and of each DASH mode. */
  readonly repeats: number;
  readonly duration_s: number;
  readonly warm_up_s: number;
}

/** One run: its configuration before it is known how large the stage is. */
export interface PlannedRun extends Omit<Required<Configuration>, "width" | "height" | "seed"> {
  readonly network: { readonly name: string; readonly rtt_ms: number | null };
  readonly profile: Profile;
}

/** What `tigas_lab.configuration` has where no controller chooses: equal runs have equal configurations. */
const UNUSED: Profile = "budget";
/** What a run takes beside its warm-up and its movement, before any was made: connecting, the first view, storing. In ms. */
const OVERHEAD = 5000;

/**
 * All runs, in their order: every mode and controller once, then all of them again, so that whatever changes in the course of an
 * experiment (another load, another hour) falls on all of them.
 */
export function runsOf(plan: ExperimentPlan): PlannedRun[] {
  const { scene, movement, network, duration_s, warm_up_s } = plan;
  const shared = {
    scene,
    movement,
    network: { name: network.trace ?? "unshaped", rtt_ms: network.trace === null ? null : network.rtt_ms },
    duration_s,
    warm_up_s,
    capture_every_ms: 0,
  };
  return Array.from({ length: plan.repeats }, (_, repeat) =>
    plan.modes.flatMap((mode) => {
      const profiles = mode === "stateless" ? plan.profiles : [UNUSED];
      return profiles.map((profile) => ({ ...shared, mode, profile, repeat }));
    }),
  ).flat();
}

/** What a run compares: its controller, or its way to stream. Rungs have the ladder's names, where it is known. */
export function conditionOf(
  { mode, profile }: Pick<PlannedRun, "mode" | "profile">,
  ladder: readonly { readonly name: string }[] = [],
): string {
  if (mode !== "stateless") return RUN_MODE_NAMES[mode];
  return typeof profile === "number"
    ? `Fixed: ${ladder[profile]?.name ?? `profile ${profile}`}`
    : CONTROLLERS[profile].title;
}

/** The viewer's settings for a run: nothing beside the picture, and no second request for a view that stands still. */
export function settingsFor({ mode, profile }: Pick<PlannedRun, "mode" | "profile">): Partial<Settings> {
  const shared = { sidebar: false, hud: false, refine: false };
  if (mode === "dash-typical") return { ...shared, mode: "dash", dashPreset: "typical" };
  if (mode === "dash-tuned") return { ...shared, mode: "dash", dashPreset: "tuned" };
  const chosen = typeof profile === "number" ? ({ controller: "fixed", profile } as const) : { controller: profile };
  return { ...shared, mode: "stateless", ...chosen };
}

/** How long so many runs take, in milliseconds; `overhead` is what they were seen to take beside warm-up and movement. */
export function timeFor(plan: Pick<ExperimentPlan, "duration_s" | "warm_up_s">, runs: number, overhead = OVERHEAD) {
  return runs * ((plan.duration_s + plan.warm_up_s) * 1000 + overhead);
}
