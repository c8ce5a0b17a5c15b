/** Opens a stream from the packager for modes that need one, again whenever a relevant setting changes. */
import { computed, effect, type ReadonlySignal, type Signal, signal, untracked } from "@preact/signals";
import { overDash } from "../dash/dash-views";
import { planFor } from "../dash/presets";
import { config } from "../state/app";
import { isStreamed } from "../state/settings";
import type { SideSettings } from "../state/sides";
import { type StreamOptions, StreamPlayer } from "../stream/stream-player";
import { AUTO_OVERSCAN } from "../stream/wider";
import { WEBRTC_PLANS, type WebRtcSetup } from "../webrtc/presets";
import { overWebRtc } from "../webrtc/webrtc-views";
import type { SceneInfo } from "../wire/render";

/** Parameters shared by all streams of a visit. */
type Shared = Omit<StreamOptions, "side" | "open" | "adaptive" | "overscan" | "prediction">;

/** A stream is opened anew when the viewport has kept its size for this long, in milliseconds. */
const RESIZED_AFTER = 400;

/** `current` is the stream that there is, or null, until the function that this returns is called. */
export function keepStream(
  current: Signal<StreamPlayer | null>,
  scene: ReadonlySignal<SceneInfo | null>,
  settings: ReadonlySignal<SideSettings>,
  shared: Shared,
): () => void {
  const [viewport, stopFollowing] = settled(shared.rig.viewport, RESIZED_AFTER);
  const wanted = computed(() => {
    const { mode, overscan } = settings.value;
    const base = config.value?.services.dash;
    const { width, height } = viewport.value;
    if (!isStreamed(mode) || base === undefined || scene.value === null || width * height <= 1) return null;
    const turned = shared.reprojector.status.value === "on";
    // As text, so that only a change of its content is one; the configuration is read again and again.
    return JSON.stringify({
      mode,
      source: {
        base,
        scene: scene.value.id,
        plan: mode === "dash" ? planFor(settings.value) : webRtcSetup(settings.value),
      },
      viewport: viewport.value,
      overscan: turned ? (overscan === "auto" ? AUTO_OVERSCAN : overscan) : null,
    });
  });
  /** Number of times the page was left and restored unchanged. */
  const returned = signal(0);
  const stop = effect(() => {
    returned.value;
    if (wanted.value === null) return undefined;
    const { mode, source, overscan } = JSON.parse(wanted.value);
    const options = { overscan, prediction: () => settings.value.prediction };
    const open = mode === "dash" ? overDash(source) : overWebRtc(source);
    const adaptive = source.plan.adaptive === true;
    const stream = untracked(() => new StreamPlayer({ ...shared, ...options, side: mode, open, adaptive }));
    current.value = stream;
    const leave = () => stream.dispose();
    const comeBack = ({ persisted }: PageTransitionEvent) => persisted && returned.value++;
    addEventListener("pagehide", leave);
    addEventListener("pageshow", comeBack);
    return () => {
      removeEventListener("pagehide", leave);
      removeEventListener("pageshow", comeBack);
      current.value = null;
      stream.dispose();
    };
  });
  return () => {
    stopFollowing();
    stop();
  };
}

/** The relevant settings, with those shared by both sides of a comparison. */
function webRtcSetup({ webrtcStream, dashRepresentation, bitrateKbps }: SideSettings): WebRtcSetup {
  return { ...WEBRTC_PLANS[webrtcStream], rung: dashRepresentation?.rung ?? null, bitrateKbps: bitrateKbps ?? null };
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
