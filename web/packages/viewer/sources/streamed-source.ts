/** A stream of the packager's as a source, reopened whenever something that determines it changes. */
import { computed, effect, type ReadonlySignal, type Signal, signal, untracked } from "@preact/signals";
import { Reprojector } from "../reproject/reprojector";
import type { SideSettings } from "../state/settings";
import { AUTO_OVERSCAN } from "../stream/camera-feed";
import { type OpenViews, STREAM_NAMES, type StreamKind } from "../stream/stream";
import { NO_STREAM_STATS, StreamPlayer, type StreamStats } from "../stream/stream-player";
import { type StreamedFrame, TurnedVideo } from "../stream/turned-video";
import type { SourcePhase } from "../view/presented";
import { keepTurning } from "./keep-turning";
import type { OpenSource, Source, SourceContext } from "./source";
import { packagerOf } from "./streamed";

/** A stream is reopened when the viewport has kept its new size for this long, in milliseconds. */
const RESIZED_AFTER = 400;

/** How a mode's stream follows from its settings. */
interface Delivery<Plan> {
  readonly kind: StreamKind;
  readonly planOf: (settings: SideSettings) => Plan;
  /** Whether stalls raise the target latency. */
  readonly adaptive: (plan: Plan) => boolean;
  readonly open: (source: {
    readonly base: string;
    readonly h3: string | null;
    readonly scene: string;
    readonly plan: Plan;
  }) => OpenViews;
}

export function openStreamed<Plan>(delivery: Delivery<Plan>): OpenSource {
  return (context) => new Streamed(context, delivery);
}

class Streamed<Plan> implements Source {
  readonly phase: ReadonlySignal<SourcePhase>;
  readonly stats: ReadonlySignal<StreamStats>;
  readonly enhancement = null;
  readonly content = null;
  readonly reprojection: Source["reprojection"];
  readonly #player: Signal<StreamPlayer | null> = signal(null);
  readonly #cleanups: readonly (() => void)[];

  constructor(context: SourceContext, { kind, planOf, adaptive, open }: Delivery<Plan>) {
    const { pane, rig, settings, scene, config, size } = context;
    const video = silentVideo();
    pane.append(video);
    const reprojector = new Reprojector<StreamedFrame>({ below: video, size, readable: TurnedVideo.supported });
    this.reprojection = reprojector.status;
    this.phase = computed(() => {
      const phase = this.#player.value?.phase.value ?? { kind: "connecting" };
      return phase.kind === "connecting" ? { ...phase, message: `Starting the ${STREAM_NAMES[kind]} stream…` } : phase;
    });
    this.stats = computed(() => this.#player.value?.stats.value ?? NO_STREAM_STATS);
    const [viewport, stopFollowing] = settled(rig.viewport, RESIZED_AFTER);
    const wanted = computed(() => {
      const { overscan } = settings.value;
      const base = packagerOf(config.value);
      if (base === undefined || scene.value === null) return null;
      const turned = reprojector.status.value === "on";
      // As text, so that only changed content counts as a change; the configuration is read repeatedly.
      return JSON.stringify({
        source: { base, h3: config.value?.dash_h3_url ?? null, scene: scene.value.id, plan: planOf(settings.value) },
        viewport: viewport.value,
        overscan: turned ? (overscan === "auto" ? AUTO_OVERSCAN : overscan) : null,
      });
    });
    const play = () =>
      effect(() => {
        if (wanted.value === null) return undefined;
        const { source, overscan } = JSON.parse(wanted.value);
        const player = untracked(
          () =>
            new StreamPlayer({
              ...context,
              video,
              reprojector,
              overscan,
              side: kind,
              open: open(source),
              adaptive: adaptive(source.plan),
              prediction: () => settings.value.prediction,
            }),
        );
        this.#player.value = player;
        return () => {
          this.#player.value = null;
          player.dispose();
        };
      });
    this.#cleanups = [
      keepTurning(reprojector, settings, scene),
      play(),
      stopFollowing,
      () => reprojector.off(),
      () => video.remove(),
    ];
  }

  picture(): Promise<ImageBitmap> | null {
    return this.#player.peek()?.picture() ?? null;
  }

  presented(now: number): void {
    this.#player.peek()?.presented(now);
  }

  resumed(gap: number): void {
    this.#player.peek()?.resumed(gap);
  }

  tick(now: number, moved: boolean): void {
    this.#player.peek()?.tick(now, moved);
  }

  played(startedAt: number) {
    return this.#player.peek()?.played(startedAt) ?? {};
  }

  async status(signal: AbortSignal) {
    return (await this.#player.peek()?.status(signal)) ?? null;
  }

  dispose(): void {
    for (const cleanup of this.#cleanups) cleanup();
  }
}

function silentVideo(): HTMLVideoElement {
  const video = document.createElement("video");
  return Object.assign(video, {
    muted: true,
    playsInline: true,
    disablePictureInPicture: true,
    disableRemotePlayback: true,
  });
}

/** A debounced copy of a signal, and a function that stops it. */
function settled<T>(source: ReadonlySignal<T>, after: number): [ReadonlySignal<T>, () => void] {
  const result = signal(source.peek());
  let timer: ReturnType<typeof setTimeout>;
  const stop = effect(() => {
    const { value } = source;
    clearTimeout(timer);
    timer = setTimeout(() => {
      result.value = value;
    }, after);
  });
  return [
    result,
    () => {
      stop();
      clearTimeout(timer);
    },
  ];
}
