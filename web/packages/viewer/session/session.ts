/**
 * One visit to one scene: connects, loads the scene, and shows the rig's view in one or two modes until disposed of.
 */

import { computed, effect, type ReadonlySignal, signal, untracked } from "@preact/signals";
import { Listeners } from "#client/async/listeners";
import { retry, sleep } from "#client/async/retry";
import { FrameWorker } from "#client/frames/frame-worker";
import { ApiError } from "#client/http/problem";
import { type Connected, connect, type TransportChoice } from "#client/transport/connect";
import { type ConnectionOptions, type ConnectionState, maintainConnection } from "#client/transport/connection";
import type { HostReport } from "#client/transport/host-report";
import type { SceneInfo, ServerConfig } from "#client/wire/render";
import { StageInput } from "../input/stage-input";
import { MovementDeck } from "../movement/movement-deck";
import { pointAt } from "../reproject/depth-of-view";
import { SOURCES } from "../sources/registry";
import { settingsAt } from "../sources/sides";
import type { Source } from "../sources/source";
import { fetchConfig, fetchScene, loadScene } from "../state/api";
import { COMPARED, type Place } from "../state/settings";
import type { ViewerState } from "../state/viewer-state";
import type { SentRequest } from "../stateless/pipeline";
import type { Reply, ShownFrame } from "../stateless/stateless-player";
import { viewDistance } from "../view/camera";
import { Presence } from "../view/presence";
import type { PresentedFrame } from "../view/presented";
import { Rig } from "../view/rig";
import { add, rotate } from "../view/vector";
import type { Comparison } from "./comparison";
import { Side } from "./side";

/** State of the visit; `failed` waits for the user. */
export type Phase =
  | { readonly kind: "connecting" }
  | { readonly kind: "loading"; readonly progress?: number }
  | { readonly kind: "playing" }
  | { readonly kind: "lost"; readonly message: string }
  | { readonly kind: "full" }
  | { readonly kind: "failed"; readonly message: string };

/** Interval of requests for the loading progress of a scene, in milliseconds. */
const PROGRESS_EVERY = 500;

/** The type of a temporary refusal: the service is starting, or no host of a cluster is up. */
const OVERLOADED = "tigas:overloaded";

/** Longest pause before an interrupted request for the scene is repeated, in milliseconds. */
const LOAD_AGAIN_WITHIN = 4000;

/** The elements of a visit: the input target, with a pane for each picture. */
export interface Stage {
  readonly element: HTMLElement;
  readonly left: HTMLElement;
  /** Empty unless two modes are compared. */
  readonly right: HTMLElement;
  /** Whether there is other content around it: keys, gamepads and the wheel then move the camera only while it has the focus. */
  readonly sharesPage?: boolean;
}

export class ViewerSession {
  readonly state: ViewerState;
  readonly phase = signal<Phase>({ kind: "connecting" });
  readonly presence = new Presence();
  readonly scene = signal<SceneInfo | null>(null);
  readonly connected = signal<Connected | null>(null);
  /** Whether the server does not answer although it is connected. */
  readonly silent = signal(false);
  readonly rig: Rig;
  readonly movement: MovementDeck;
  /** The only side, unless two modes are compared. */
  readonly left: Side;
  /** Null unless two modes are compared. */
  readonly right = signal<Side | null>(null);
  /** State of the right side's own connection, if it has one. */
  readonly rightConnection = signal<ConnectionState | null>(null);
  /** Set for streams and comparisons; otherwise null. */
  readonly comparison = signal<Comparison | null>(null);
  /** The sources on the stage, from left to right. */
  readonly sources: ReadonlySignal<readonly Source[]> = computed(() =>
    [this.left, this.right.value].flatMap((side) => side?.source.value ?? []),
  );
  /** Notice to the user if the pictures of a side should be warped but are not; otherwise null. */
  readonly unturned = computed(() => this.left.unturned.value ?? this.right.value?.unturned.value ?? null);
  readonly input: StageInput;
  readonly stage: Stage;
  /** Screen pixels per viewport pixel. */
  readonly pixelRatio = signal(devicePixelRatio);
  /** Seed of the controllers' random numbers. */
  readonly seed = signal(1);
  readonly #sceneId: string;
  readonly #presented = new Listeners<[PresentedFrame]>();
  readonly #shown = new Listeners<[ShownFrame]>();
  readonly #sent = new Listeners<[SentRequest]>();
  readonly #replied = new Listeners<[Reply]>();
  /** Subscribes to every frame on screen, of any side; returns a function that unsubscribes. */
  readonly onPresented = this.#presented.add;
  /** Like `onPresented`, for frames requested one by one, before any warp. */
  readonly onShown = this.#shown.add;
  /** Like `onPresented`, for every request for a frame. */
  readonly onSent = this.#sent.add;
  /** Like `onPresented`, for every received frame. */
  readonly onReplied = this.#replied.add;
  readonly #frames = new FrameWorker();
  #loading: Promise<SceneInfo> | undefined;
  /** The host on which the scene is loaded, in a cluster. */
  #host: string | null = null;
  #animation = 0;
  /** Bytes of sides that were closed. */
  #receivedBefore = 0;
  /** Number of connections requested by the user. */
  readonly #attempt = signal(0);
  readonly #cleanups: (() => void)[] = [];

  constructor(sceneId: string, stage: Stage, state: ViewerState) {
    const { settings } = state;
    this.state = state;
    this.#sceneId = sceneId;
    this.stage = stage;
    this.input = new StageInput(stage.element, {
      focal: () => this.rig.intrinsics.value,
      orbits: () => settings.peek().drag === "orbit",
      keysAnywhere: () => settings.peek().shortcuts,
      onFocus: (event) => this.#focus(event),
      sharesPage: stage.sharesPage ?? false,
    });
    this.rig = new Rig({
      sampleInput: (elapsed) => this.input.sample(elapsed),
      turnSpeed: () => settings.value.turnSpeed,
    });
    this.movement = new MovementDeck(this.rig, state.movement);
    this.left = this.#side("left");
    this.#follow(stage);
    this.#connect();
    this.#compare();
    this.#measure();
    this.#followLadder();
    this.#animation = requestAnimationFrame(this.#tick);
  }

  /** The left side's source, which experiments measure. */
  get source(): ReadonlySignal<Source | null> {
    return this.left.source;
  }

  get receivedBytes(): number {
    return this.#receivedBefore + this.#sides.reduce((sum, { receivedBytes }) => sum + receivedBytes, 0);
  }

  /** Connects and loads again after a failure. */
  retry(): void {
    this.#loading = undefined; // its file may have been replaced
    this.#attempt.value++;
  }

  dispose(): void {
    cancelAnimationFrame(this.#animation);
    this.state.sceneLadder.value = null;
    for (const cleanup of this.#cleanups) cleanup();
    this.presence.dispose();
    this.movement.dispose();
    this.input.dispose();
    this.left.dispose();
    this.#frames.dispose();
  }

  get #sides(): readonly Side[] {
    const right = this.right.peek();
    return right ? [this.left, right] : [this.left];
  }

  #side(place: Place): Side {
    const { settings, config, ladder } = this.state;
    const side = new Side({
      pane: this.stage[place],
      rig: this.rig,
      scene: this.scene,
      settings: computed(() => settingsAt(place, settings.value, ladder.value)),
      config,
      ladder,
      left: this.presence.left,
      seed: this.seed,
      pixelRatio: this.pixelRatio,
      onShown: this.#shown.tell,
      onSent: this.#sent.tell,
      onReplied: this.#replied.tell,
    });
    side.onPresented(this.#presented.tell);
    return side;
  }

  /** Focuses the clicked point: at the depth of the newest frame, or at the distance of the scene's first view. */
  #focus({ clientX, clientY }: MouseEvent): void {
    const scene = this.scene.peek();
    // The stage has captured the pointer and is the event's only target.
    const pane = [this.stage.left, this.stage.right]
      .map((element) => element.getBoundingClientRect())
      .find(({ left, right, top, bottom }) => clientX >= left && clientX < right && clientY >= top && clientY < bottom);
    if (!pane || scene === null) return;
    const { fx, fy, cx, cy } = this.rig.intrinsics.peek();
    const { position, quaternion } = this.rig.pose;
    const direction = rotate(quaternion, [(clientX - pane.left - cx) / fx, (clientY - pane.top - cy) / fy, 1]);
    const content = this.source.peek()?.content;
    const length = viewDistance(scene) / Math.hypot(...direction);
    const usual = add(position, [direction[0] * length, direction[1] * length, direction[2] * length]);
    const smooth = !matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.rig.focus((content && pointAt(content.view, content.depth, direction)) ?? usual, smooth);
  }

  /** The loop: samples the input once per animation frame, for all modes. */
  readonly #tick = (): void => {
    this.#animation = requestAnimationFrame(this.#tick);
    if (!this.presence.visible.peek()) return;
    const time = now();
    const gap = this.presence.gap(time);
    if (gap > 0) {
      for (const source of this.sources.peek()) source.resumed(gap);
      this.comparison.peek()?.resumed();
    }
    for (const source of this.sources.peek()) source.presented(time);
    const moved = this.rig.sample(time);
    for (const source of this.sources.peek()) source.tick(time, moved);
  };

  /** The viewport is that of the left pane; where there are two, both have the same size. */
  #follow({ left }: Stage): void {
    const observer = new ResizeObserver(() => this.rig.resize(left.clientWidth, left.clientHeight));
    observer.observe(left);
    const screen = new AbortController();
    const followScreen = () => {
      this.pixelRatio.value = devicePixelRatio;
      const query = matchMedia(`(resolution: ${devicePixelRatio}dppx)`);
      query.addEventListener("change", followScreen, { once: true, signal: screen.signal });
    };
    followScreen();
    this.#cleanups.push(() => {
      observer.disconnect();
      screen.abort();
    });
  }

  /** Opens and closes the right side of a comparison. */
  #compare(): void {
    const compared = computed(() => this.state.settings.value.mode === COMPARED);
    const stop = effect(() => {
      if (!compared.value) return undefined;
      const right = untracked(() => this.#side("right"));
      this.right.value = right;
      const disconnect = this.#connectRight(right);
      return () => {
        disconnect();
        this.right.value = null;
        this.#receivedBefore += right.receivedBytes;
        right.dispose();
      };
    });
    this.#cleanups.push(stop);
  }

  /**
   * Measures the pictures on the stage, starting over when they change: figures of other modes do not apply to them.
   */
  #measure(): void {
    const measured = computed(() => {
      const { mode, left, right } = this.state.settings.value;
      if (mode === COMPARED) return this.right.value === null ? null : `${left} ${right}`;
      return SOURCES[mode].charts ? mode : null;
    });
    const stop = effect(() => {
      if (measured.value === null) return undefined;
      let ended = false;
      import("./comparison").then(
        ({ Comparison }) => {
          if (!ended) this.comparison.value = new Comparison(this.rig, this.#sides, this.presence, this.state.config);
        },
        () => undefined, // figures are missing; the page reports that it is outdated
      );
      return () => {
        ended = true;
        const comparison = this.comparison.peek();
        this.comparison.value = null;
        comparison?.dispose();
      };
    });
    this.#cleanups.push(stop);
  }

  /**
   * The right side's separate connection for per-pose requests: a client's newest request replaces its earlier ones.
   */
  #connectRight(right: Side): () => void {
    const choice = computed(() =>
      right.kind.value.requests && this.scene.value !== null && !this.presence.left.value
        ? this.state.settings.value.transport
        : null,
    );
    return this.#keepConnected(
      choice,
      (chosen) => ({
        fetchConfig: (signal, report) => this.#fetchConfig(signal, report),
        connect: (server, signal) => connect(server, chosen, signal, now, this.#frames),
        onState: (state) =>
          untracked(() => {
            this.rightConnection.value = state;
            right.attach(state.status === "connected" ? state : null);
          }),
        onSilence: () => undefined, // reported by the left side's connection
      }),
      () => {
        this.rightConnection.value = null;
        right.attach(null);
      },
    );
  }

  /** Connects over the chosen transport, and again whenever another is chosen; null closes the connection. */
  #keepConnected(
    choice: ReadonlySignal<TransportChoice | null>,
    options: (
      chosen: TransportChoice,
      signal: AbortSignal,
    ) => Pick<ConnectionOptions, "fetchConfig" | "connect" | "onState" | "onSilence">,
    ended: () => void,
  ): () => void {
    return effect(() => {
      const chosen = choice.value;
      if (chosen === null) return undefined;
      this.#attempt.value; // an effect runs again when its inputs change
      const connection = new AbortController();
      const { signal } = connection;
      const common = { visible: this.presence.untilVisible, now };
      void maintainConnection({ ...options(chosen, signal), ...common }, signal);
      return () => {
        connection.abort();
        ended();
      };
    });
  }

  /** Reloads the ladder after a refusal: the rung may no longer exist, as the scene's ladder can change after it was entered. */
  #followLadder(): void {
    const refused = computed(() => {
      const phase = this.source.value?.phase.value;
      return phase?.kind === "playing" && phase.problem !== undefined;
    });
    const visit = new AbortController();
    const stop = effect(() => {
      if (!refused.value || this.scene.peek() === null) return;
      const reread = this.#ask(visit.signal).then((scene) => {
        if (!visit.signal.aborted) this.state.sceneLadder.value = scene.ladder ?? null;
      });
      reread.catch(() => undefined); // the refusal is already shown
    });
    this.#cleanups.push(() => {
      stop();
      visit.abort();
    });
  }

  /** Connects, and reconnects whenever another transport is chosen. */
  #connect(): void {
    const choice = computed(() => (this.presence.left.value ? null : this.state.settings.value.transport));
    const stop = this.#keepConnected(
      choice,
      (chosen, visit) => ({
        fetchConfig: async (signal, report) => {
          const config = await this.#fetchConfig(signal, report);
          this.state.config.value = config;
          if (config.has_scene === false) untracked(() => this.#gone());
          return config;
        },
        connect: async (server, signal) => {
          const loading = this.#loadAt(server.host ?? null, visit);
          loading.catch(() => undefined); // #play reports a failure
          // The current picture stays until another host is ready; otherwise both steps run concurrently.
          if (this.connected.peek() !== null) await loading.catch(() => undefined);
          return connect(server, chosen, signal, now, this.#frames);
        },
        onState: (state) => untracked(() => this.#heard(state, visit)),
        onSilence: (silent) => {
          this.silent.value = silent;
        },
      }),
      () => {
        this.#loading = undefined; // the server may unload it, or another file may take its name
      },
    );
    const online = computed(() => !this.presence.offline.value);
    const tryAgain = effect(() => {
      if (online.value && this.phase.peek().kind === "lost") untracked(() => this.#attempt.value++);
    });
    this.#cleanups.push(stop, tryAgain);
  }

  #fetchConfig(signal: AbortSignal, report?: HostReport): Promise<ServerConfig> {
    return fetchConfig(signal, { scene: this.#sceneId, ...report }, this.state.server);
  }

  #heard(state: ConnectionState, signal: AbortSignal): void {
    this.connected.value = state.status === "connected" ? state : null;
    if (state.status !== "connected") this.left.attach(null);
    if (state.status === "lost") this.#loading = undefined; // a restarted server may have another ladder for it
    if (state.status === "connecting") this.phase.value = { kind: "connecting" };
    else if (state.status === "lost") this.phase.value = { kind: "lost", message: state.reason };
    else if (state.status === "full") this.phase.value = { kind: "full" };
    else void this.#play(state, signal);
  }

  /** Fails because the scene was deleted or renamed: a resting camera sends no requests and would never notice. */
  #gone(): void {
    const scene = this.scene.peek();
    if (scene === null || !["loading", "playing"].includes(this.phase.peek().kind)) return;
    for (const side of this.#sides) side.attach(null);
    this.#loading = undefined;
    this.phase.value = { kind: "failed", message: `${scene.name} was deleted or renamed on the server.` };
  }

  /** Requests the scene from a new host, or else like `#load`. */
  #loadAt(host: string | null, signal: AbortSignal): Promise<SceneInfo> {
    if (host !== this.#host) this.#loading = undefined;
    this.#host = host;
    return this.#load(signal);
  }

  /** Requests the scene, once at a time; after a failure it may be requested again. */
  #load(signal: AbortSignal): Promise<SceneInfo> {
    this.#loading ??= this.#ask(signal).catch((error: unknown) => {
      this.#loading = undefined;
      throw error;
    });
    return this.#loading;
  }

  #ask(signal: AbortSignal, coarse = false): Promise<SceneInfo> {
    return loadScene(this.#sceneId, signal, { host: this.#host, server: this.state.server, coarse });
  }

  /** Shows the scene coarsely while it loads, if the server can. */
  async #showCoarse(connected: Connected, signal: AbortSignal): Promise<void> {
    const scene = await this.#ask(signal, true);
    if (scene.state === "loading" && this.#loadsOver(connected)) this.#show(scene, connected);
  }

  /** Reports the progress of loading until it ends. */
  async #followLoading(connected: Connected, signal: AbortSignal): Promise<void> {
    for (;;) {
      await sleep(PROGRESS_EVERY, signal);
      await this.presence.untilVisible(signal);
      const progress = (await fetchScene(this.#sceneId, this.state.server).catch(() => null))?.progress ?? undefined;
      if (!this.#loadsOver(connected)) return;
      if (progress !== undefined) this.phase.value = { kind: "loading", progress };
    }
  }

  #loadsOver(connected: Connected): boolean {
    return this.phase.peek().kind === "loading" && this.#isConnectedOver(connected);
  }

  #isConnectedOver({ transport }: Connected): boolean {
    return this.connected.peek()?.transport === transport;
  }

  async #play(connected: Connected, signal: AbortSignal): Promise<void> {
    // The picture of another host continues if this one has the scene.
    if (this.phase.peek().kind !== "playing" || this.#loading === undefined) {
      this.phase.value = { kind: "loading" };
      // A loaded scene stays, since modes that draw it in the browser would load it again.
      if (this.scene.peek()?.state !== "loaded") this.#showCoarse(connected, signal).catch(() => undefined); // `#load` reports why
      this.#followLoading(connected, signal).catch(() => undefined); // it has ended
    }
    let loaded: SceneInfo;
    try {
      loaded = await retry(() => this.#load(signal), {
        signal,
        maxTimeout: LOAD_AGAIN_WITHIN,
        shouldRetry: (error) =>
          error instanceof ApiError &&
          (error.unreachable || error.type === OVERLOADED) &&
          this.#isConnectedOver(connected),
      });
    } catch (error) {
      if (signal.aborted || !this.#isConnectedOver(connected)) return; // there is another attempt
      if (!(error instanceof ApiError)) return;
      for (const side of this.#sides) side.attach(null);
      this.phase.value = { kind: "failed", message: error.message };
      return;
    }
    if (!signal.aborted) this.#show({ ...loaded, state: "loaded" }, connected);
  }

  #show(scene: SceneInfo, connected: Connected): void {
    if (this.scene.value === null) this.rig.enter(scene);
    else this.rig.update(scene);
    this.scene.value = scene;
    this.state.sceneLadder.value = scene.ladder ?? null;
    if (!this.#isConnectedOver(connected)) return; // it was lost meanwhile
    this.left.attach(connected);
    if (scene.state !== "loading") this.phase.value = { kind: "playing" };
  }
}

const now = () => performance.now();
