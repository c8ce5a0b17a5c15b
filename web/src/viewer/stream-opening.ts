/** Opens a DASH stream where the mode has one, and anew whenever what decides it changes. */
import { computed, effect, type ReadonlySignal, type Signal, signal, untracked } from "@preact/signals";
import { type DashOptions, DashPlayer } from "../dash/dash-player";
import { planFor } from "../dash/presets";
import { AUTO_OVERSCAN } from "../dash/wider";
import { config, settings } from "../state/app";
import { isStreamed } from "../state/settings";
import type { SceneInfo } from "../wire/render";

/** What all streams of a visit have in common. */
type Shared = Omit<DashOptions, "base" | "scene" | "plan" | "overscan" | "prediction">;

/** A stream is opened anew when the viewport has kept its size for this long, in milliseconds. */
const RESIZED_AFTER = 400;

/** `current` is the stream that there is, or null, until the function that this returns is called. */
export function keepStream(
  current: Signal<DashPlayer | null>,
  scene: ReadonlySignal<SceneInfo | null>,
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
      base,
      scene: scene.value.id,
      plan: planFor(settings.value),
      viewport: viewport.value,
      overscan: turned ? (overscan === "auto" ? AUTO_OVERSCAN : overscan) : null,
    });
  });
  /** How often the page was left and shown again as it was. */
  const returned = signal(0);
  const stop = effect(() => {
    returned.value;
    if (wanted.value === null) return undefined;
    const { viewport: _, ...options } = JSON.parse(wanted.value);
    const prediction = () => settings.value.prediction;
    const dash = untracked(() => new DashPlayer({ ...shared, ...options, prediction }));
    current.value = dash;
    const leave = () => dash.dispose();
    const comeBack = ({ persisted }: PageTransitionEvent) => persisted && returned.value++;
    addEventListener("pagehide", leave);
    addEventListener("pageshow", comeBack);
    return () => {
      removeEventListener("pagehide", leave);
      removeEventListener("pageshow", comeBack);
      current.value = null;
      dash.dispose();
    };
  });
  return () => {
    stopFollowing();
    stop();
  };
}

/** A signal that follows another once that has kept its value for a while, and what ends that. */
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
