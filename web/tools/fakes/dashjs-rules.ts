/**
 * dash.js's own LoL+ and L2A, for tests: the published rules, with stand-ins for the player. Their state is private: LoL+'s is
 * read where it is passed to its weight selector, L2A's where it passes through Math.max.
 */
import { vi } from "vitest";

export interface Segment {
  /** Bits per second, before any safety margin. */
  readonly throughput: number;
  /** Duration in seconds. */
  readonly buffer: number;
  readonly latency: number;
}

interface Representation {
  readonly id: string;
  readonly absoluteIndex: number;
  readonly bandwidth: number;
  readonly bitrateInKbit: number;
  readonly fragmentDuration: number;
}

interface Rule {
  getSwitchRequest(context: object): { readonly representation: Representation | null };
}

interface FactoryMaker {
  extend(name: string, extension: unknown, override: boolean, context: object): void;
  getClassFactoryByName(name: string): (context: object) => { create(config: object): Rule };
  setSingletonInstance(context: object, name: string, instance: unknown): void;
}

const DURATION = 0.5;

/** dash.js inspects the page when it loads and leaves its factories there. */
async function load(): Promise<FactoryMaker> {
  const page: { skipAutoCreate: boolean; FactoryMaker?: FactoryMaker } = { skipAutoCreate: true };
  vi.stubGlobal("window", globalThis);
  vi.stubGlobal("document", { documentElement: { style: {} }, readyState: "complete" });
  vi.stubGlobal("navigator", { userAgent: "" });
  vi.stubGlobal("getComputedStyle", () => ({}));
  vi.stubGlobal("dashjs", page);
  await import("dashjs");
  vi.unstubAllGlobals();
  if (page.FactoryMaker === undefined) throw new Error("dash.js now keeps its factories elsewhere.");
  return page.FactoryMaker;
}

const factories = await load();

/** A player that plays these bitrates (bits per second, the lowest first), as far as the rules need it. */
class Player {
  readonly context = {};
  readonly representations: readonly Representation[];
  current: Representation;
  segment: Segment = { throughput: Number.NaN, buffer: 0, latency: 0 };
  #requests = 0;

  /** `unit` is the number of bits per unit of the manifest's `bandwidth`; 1 as in dash.js. */
  constructor(bitrates: readonly number[], unit = 1) {
    this.representations = bitrates.map((bitrate, i) => ({
      id: String(i),
      absoluteIndex: i,
      bandwidth: bitrate / unit,
      bitrateInKbit: bitrate / 1000,
      fragmentDuration: DURATION,
    }));
    this.current = this.representations[0] as Representation;
  }

  get config(): object {
    const request = () => ({ url: String(this.#requests), trequest: new Date(0), tresponse: new Date(0) });
    const buffer = () => this.segment.buffer;
    const dashMetrics = {
      getCurrentBufferState: () => ({}),
      getCurrentBufferLevel: buffer,
      getCurrentHttpRequest: request,
    };
    return { dashMetrics };
  }

  ask(rule: Rule, segment: Segment, safety: number): number {
    this.segment = segment;
    this.#requests++;
    const kbps = segment.throughput / 1000;
    const schedule = {
      setTimeToLoadDelay: () => undefined,
      getPlaybackController: () => ({
        getCurrentLiveLatency: () => segment.latency,
        getPlaybackRate: () => 1,
      }),
    };
    const abr = {
      getAbandonmentStateFor: () => "",
      getPossibleVoRepresentationsFilteredBySettings: () => this.representations,
      getOptimalRepresentationForBitrate: (_: object, limit: number) =>
        this.representations.findLast(({ bitrateInKbit }) => bitrateInKbit <= limit) ?? this.representations[0],
      getRepresentationByAbsoluteIndex: (i: number) => this.representations[i],
    };
    const answer = rule.getSwitchRequest({
      getMediaInfo: () => ({ type: "video" }),
      getMediaType: () => "video",
      getStreamInfo: () => ({ id: "" }),
      getRepresentation: () => this.current,
      getAbrController: () => abr,
      getScheduleController: () => schedule,
      getThroughputController: () => ({
        getSafeAverageThroughput: () => safety * kbps,
        getAverageThroughput: () => kbps,
      }),
      getVideoModel: () => ({ getPlaybackRate: () => 1 }),
    });
    this.current = answer.representation ?? this.current;
    return this.current.absoluteIndex;
  }
}

interface Neuron {
  readonly state: { throughput: number; latency: number; rebuffer: number; switch: number };
}

export class DashLolp {
  readonly #player: Player;
  readonly #rule: Rule;
  readonly #safety: number;
  #neurons: readonly Neuron[] = [];
  /** The selector's last result; -1 if it found nothing. */
  weights: readonly number[] | -1 = -1;

  private constructor(maker: FactoryMaker, bitrates: readonly number[], safety: number) {
    this.#player = new Player(bitrates);
    this.#safety = safety;
    const { context, config } = this.#player;
    const heard = (neurons: readonly Neuron[], weights: readonly number[] | -1) => {
      this.#neurons = neurons;
      this.weights = weights;
    };
    interface Selector {
      findWeightVector(neurons: readonly Neuron[], ...others: unknown[]): readonly number[] | -1;
    }
    function listening(this: { parent: Selector }): Selector {
      const { findWeightVector } = this.parent;
      return {
        findWeightVector: (neurons, ...others) => {
          const weights = findWeightVector(neurons, ...others);
          heard(neurons, weights);
          return weights;
        },
      };
    }
    maker.extend("LoLpWeightSelector", listening, true, context);
    this.#rule = maker.getClassFactoryByName("LoLPRule")(context).create(config);
  }

  /** dash.js draws its first weights from Math.random, which is replaced by `random` for its first segment. */
  static async create(bitrates: readonly number[], safety: number): Promise<DashLolp> {
    return new DashLolp(factories, bitrates, safety);
  }

  /** The index of the chosen bitrate. */
  segment(segment: Segment): number {
    return this.#player.ask(this.#rule, segment, this.#safety);
  }

  get neurons(): number[][] {
    return this.#neurons.map(({ state }) => [state.throughput, state.latency, state.rebuffer, state.switch]);
  }
}

export class DashL2a {
  readonly #player: Player;
  readonly #rule: Rule;
  #loaded: (event: object) => void = () => undefined;
  readonly #safety: number;
  /** The state after the last segment in the steady state. */
  w: readonly number[] = [];
  q = Number.NaN;

  private constructor(maker: FactoryMaker, bitrates: readonly number[], safety: number, unit: number) {
    this.#player = new Player(bitrates, unit);
    this.#safety = safety;
    const { context, config } = this.#player;
    const on = (event: string | undefined, listener: (event: object) => void) => {
      if (event === "mediaFragmentLoaded") this.#loaded = listener;
    };
    maker.setSingletonInstance(context, "EventBus", { on, off: () => undefined });
    this.#rule = maker.getClassFactoryByName("L2ARule")(context).create(config);
    this.#player.ask(this.#rule, { throughput: Number.NaN, buffer: 0, latency: 0 }, safety); // creates its state
  }

  static async create(bitrates: readonly number[], safety: number, unit: number): Promise<DashL2a> {
    return new DashL2a(factories, bitrates, safety, unit);
  }

  /** The index of the chosen bitrate. */
  segment(segment: Segment): number {
    const { current: representation, representations } = this.#player;
    const chunk = { start: 0, duration: DURATION, representation: { ...representation, mediaInfo: { type: "video" } } };
    this.#loaded({ chunk });
    const max = vi.spyOn(Math, "max");
    const choice = this.#player.ask(this.#rule, segment, this.#safety);
    const values = max.mock.results.map(({ value }) => value as number);
    max.mockRestore();
    if (values.length > 0) {
      // The step size, all of w, Q, and the new Q after an overestimate.
      this.w = values.slice(1, 1 + representations.length);
      const [q = Number.NaN, least] = values.slice(1 + representations.length);
      this.q = least === undefined ? q : 2 * least;
    }
    return choice;
  }
}
