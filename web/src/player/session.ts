/** One visit to one scene: connects, loads the scene, and feeds input to the player, until it is disposed of. */
import { computed, effect, signal, untracked } from "@preact/signals";
import { FixedController } from "../abr/controller";
import { StageInput } from "../input/stage-input";
import { ApiError, fetchConfig, loadScene } from "../state/api";
import { config, settings } from "../state/app";
import { type Connected, connect } from "../transport/connect";
import { type ConnectionState, maintainConnection } from "../transport/connection";
import type { SceneInfo } from "../wire";
import { Decoder } from "./decoder";
import { Player } from "./player";

/** How the visit stands; `failed` waits for the person. */
export type Phase =
  | { readonly kind: "connecting" }
  | { readonly kind: "loading" }
  | { readonly kind: "playing" }
  | { readonly kind: "lost"; readonly message: string }
  | { readonly kind: "failed"; readonly message: string };

export class ViewerSession {
  readonly phase = signal<Phase>({ kind: "connecting" });
  readonly scene = signal<SceneInfo | null>(null);
  readonly connected = signal<Connected | null>(null);
  readonly player: Player;
  readonly input: StageInput;
  readonly #sceneId: string;
  readonly #decoder = new Decoder(
    new Worker(new URL("./decode.worker.ts", import.meta.url), { type: "module", name: "decoder" }),
  );
  /** The chosen rung, or the last if the server's ladder is shorter. */
  readonly #controller = computed(
    () => new FixedController(Math.min(settings.value.profile, Math.max(0, (config.value?.ladder.length ?? 1) - 1))),
  );
  #loading: Promise<SceneInfo> | undefined;
  /** Counts connections that a person asked for. */
  readonly #attempt = signal(0);
  readonly #cleanups: (() => void)[] = [];

  constructor(sceneId: string, stage: HTMLElement, canvas: HTMLCanvasElement) {
    this.#sceneId = sceneId;
    this.input = new StageInput(stage, () => this.player.intrinsics.value);
    this.player = new Player({
      canvas,
      decoder: this.#decoder,
      sampleInput: (elapsed) => this.input.sample(elapsed),
      controller: () => this.#controller.value,
      refine: () => settings.value.refine,
      turnSpeed: () => settings.value.turnSpeed,
      now,
    });
    const observer = new ResizeObserver(() => this.player.resize(stage.clientWidth, stage.clientHeight));
    observer.observe(stage);
    this.#cleanups.push(() => observer.disconnect());
    this.#connect();
  }

  /** After a failure: connect and load again. */
  retry(): void {
    this.#attempt.value++;
  }

  /** Connects, and connects anew whenever another transport is chosen. */
  #connect(): void {
    const choice = computed(() => settings.value.transport);
    const stop = effect(() => {
      const chosen = choice.value;
      this.#attempt.value; // an effect runs again when what it read changes
      const connection = new AbortController();
      void maintainConnection(
        {
          fetchConfig: async (signal) => {
            config.value = await fetchConfig(signal);
            return config.value;
          },
          connect: (server, signal) => {
            void this.#load(connection.signal).catch(() => undefined); // side by side; #play hears of a failure
            return connect(server, chosen, signal, now);
          },
          onState: (state) => untracked(() => this.#follow(state, connection.signal)),
          sleep,
        },
        connection.signal,
      );
      return () => connection.abort();
    });
    this.#cleanups.push(stop);
  }

  dispose(): void {
    for (const cleanup of this.#cleanups) cleanup();
    this.input.dispose();
    this.player.dispose();
    this.#decoder.dispose();
  }

  #follow(state: ConnectionState, signal: AbortSignal): void {
    this.connected.value = state.status === "connected" ? state : null;
    if (state.status !== "connected") this.player.attach(null);
    if (state.status === "connecting") this.phase.value = { kind: "connecting" };
    else if (state.status === "lost") this.phase.value = { kind: "lost", message: state.reason };
    else void this.#play(state, signal);
  }

  /** Asks for the scene once at a time; after a failure it may be asked for again. */
  #load(signal: AbortSignal): Promise<SceneInfo> {
    this.#loading ??= loadScene(this.#sceneId, signal).catch((error: unknown) => {
      this.#loading = undefined;
      throw error;
    });
    return this.#loading;
  }

  async #play(connected: Connected, signal: AbortSignal): Promise<void> {
    if (this.scene.value === null) {
      this.phase.value = { kind: "loading" };
      try {
        this.scene.value = await this.#load(signal);
      } catch (error) {
        if (signal.aborted || !(error instanceof ApiError) || error.unreachable) return; // the connection will say
        this.phase.value = { kind: "failed", message: error.message };
        return;
      }
      this.player.enter(this.scene.value);
    }
    if (this.connected.value?.transport !== connected.transport) return; // it was lost meanwhile
    this.player.attach(connected);
    this.phase.value = { kind: "playing" };
  }
}

const now = () => performance.now();

function sleep(milliseconds: number, signal: AbortSignal): Promise<void> {
  return new Promise((resolve, reject) => {
    signal.throwIfAborted();
    const abort = () => {
      clearTimeout(timer);
      reject(signal.reason);
    };
    const timer = setTimeout(() => {
      signal.removeEventListener("abort", abort);
      resolve();
    }, milliseconds);
    signal.addEventListener("abort", abort, { once: true });
  });
}
