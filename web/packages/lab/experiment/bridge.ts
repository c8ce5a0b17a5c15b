/** `window.tigas`, with which scripts drive and measure the viewer. Pictures are fetched one by one after a run. */

import * as v from "valibot";
import type { Recording, Sample } from "#client/wire/store";
import type { Settings } from "#viewer/state/settings";
import type { ScenePose } from "#viewer/view/camera";
import { readSampledRun, type SampledRun } from "../samples/sampled-runs";
import { whyFewer } from "../samples/sampler";
import type { Runner, RunnerState, RunPlan } from "./runner";

const Numbers = <N extends number>(length: N) => v.pipe(v.array(v.pipe(v.number(), v.finite())), v.length(length));
const Seed = v.pipe(v.number(), v.safeInteger(), v.minValue(0));
const Pose = v.object({ position: Numbers(3), quaternion: Numbers(4) });
const Plan = v.object({
  points: v.pipe(v.array(v.object({ t_ms: v.pipe(v.number(), v.finite()), ...Pose.entries })), v.minLength(1)),
  duration_ms: v.pipe(v.number(), v.minValue(1)),
  capture_every_ms: v.pipe(v.number(), v.minValue(0)),
  sample_stride: v.optional(v.pipe(v.number(), v.integer(), v.minValue(0)), 0),
  download: v.optional(v.boolean(), false),
});

export interface SampleList {
  readonly samples: readonly Sample[];
  readonly pictures: readonly string[];
  readonly problem: string | null;
}

class Bridge {
  readonly #runner: Runner;
  #sampled: SampledRun | null = null;

  constructor(runner: Runner) {
    this.#runner = runner;
  }

  /** Changes settings, or the seed of the controllers' random numbers. Throws if one is invalid. */
  settings({ seed, ...part }: Partial<Settings> & { readonly seed?: number }): void {
    if (seed !== undefined) this.#runner.seed(v.parse(Seed, seed));
    this.#runner.settings(part);
  }

  /** Reconnects, over the network in its current state. */
  reconnect(): void {
    this.#runner.reconnect();
  }

  /** Holds a pose in the scene's own frame until a run begins. */
  stand(pose: unknown): void {
    this.#runner.stand(v.parse(Pose, pose) as unknown as ScenePose);
  }

  state(): RunnerState {
    return this.#runner.state();
  }

  /** Plays and records a movement; one at a time. */
  async run(plan: unknown): Promise<Recording> {
    return this.#runner.run(v.parse(Plan, plan) as unknown as RunPlan);
  }

  /** The last run's samples, the names of their pictures, and the reason if some are missing; the page keeps them all. */
  async samples(): Promise<SampleList> {
    const { sampled } = this.#runner;
    this.#sampled = sampled?.key ? await readSampledRun(sampled.key) : null;
    const { samples = [], pictures = new Map<string, File>() } = this.#sampled ?? {};
    return { samples, pictures: [...pictures.keys()], problem: sampled && whyFewer(sampled) };
  }

  /** One of these pictures by its name, as base64 text. */
  async samplePicture(name: string): Promise<string> {
    const picture = this.#sampled?.pictures.get(name);
    if (!picture) throw new Error(`there is no picture ${name}`);
    return base64(new Uint8Array(await picture.arrayBuffer()));
  }

  /** A captured picture as the base64 text of a PNG; the page then drops it. */
  async capture(index: number): Promise<string> {
    const picture = await this.#runner.takePicture(index);
    return base64(new Uint8Array(await picture.arrayBuffer()));
  }
}

declare global {
  var tigas: Bridge | undefined;
}

/** Offers the bridge to scripts; returns a function that withdraws it. */
export function offerBridge(runner: Runner): () => void {
  const bridge = new Bridge(runner);
  globalThis.tigas = bridge;
  return () => {
    if (globalThis.tigas === bridge) globalThis.tigas = undefined;
  };
}

function base64(bytes: Uint8Array): string {
  let text = "";
  for (let at = 0; at < bytes.length; at += 32_768) text += String.fromCharCode(...bytes.subarray(at, at + 32_768));
  return btoa(text);
}
