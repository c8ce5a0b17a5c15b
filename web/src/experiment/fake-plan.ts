import { type ExperimentPlan, FROM_THE_START, UNSHAPED } from "./plan";

/** Plan of an experiment, for tests: one run of one mode over the unshaped link. */
export function experimentPlan(changes: Partial<ExperimentPlan> = {}): ExperimentPlan {
  return {
    name: "two",
    scene: "courtyard",
    movement: "stroll",
    network: UNSHAPED,
    modes: ["stateless"],
    profiles: ["latency"],
    repeats: 1,
    segments: FROM_THE_START,
    dash_frame_rate: null,
    restore: "off",
    upscale: "off",
    reprojection: false,
    prediction: "off",
    overscan: "auto",
    depth: true,
    surround: true,
    seed: 1,
    shuffled: false,
    duration_s: 10,
    warm_up_s: 2,
    sample_stride: 0,
    ...changes,
  };
}
