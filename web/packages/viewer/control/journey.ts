/** Journeys of the camera along a path, until its end or until something else moves the camera. */
import { effect, untracked } from "@preact/signals";
import { deferred } from "#client/async/deferred";
import { type CameraPath, cameraPath, type Easing } from "../movement/camera-path";
import type { ViewerSession } from "../session/session";
import type { ScenePose } from "../view/camera";

/** Default duration of a flight to a pose, in milliseconds. */
const USUAL_DURATION = 1000;

type Traveller = Pick<ViewerSession, "rig" | "stage">;

/** Resolves, when the journey is over, to whether the camera reached the end of the path. */
export function travel({ rig, stage }: Traveller, path: CameraPath, loop = false): Promise<boolean> {
  const { promise, resolve } = deferred<boolean>();
  let startedAt: number | null = null;
  const source = (now: number) => {
    startedAt ??= now;
    const time = now - startedAt;
    if (loop) return path.at(time % path.duration);
    if (time < path.duration) return path.at(time);
    rig.place(path.at(path.duration)); // the user continues from here
    resolve(true);
    return null;
  };
  rig.drive(source, { yields: true });
  const listening = new AbortController();
  const { signal } = listening;
  stage.element.addEventListener("pointerdown", () => rig.takeOver(), { signal });
  const keyboard: EventTarget = stage.sharesPage ? stage.element : window;
  keyboard.addEventListener("keydown", (event) => (event as KeyboardEvent).key === "Escape" && rig.takeOver(), {
    signal,
  });
  const stop = effect(() => {
    if (rig.source.value === source) return;
    untracked(() => {
      listening.abort();
      resolve(false);
    });
  });
  void promise.then(stop);
  return promise;
}

/** Travels to a pose, in `duration` milliseconds. */
export function travelTo(
  traveller: Traveller,
  to: ScenePose,
  { duration = USUAL_DURATION, easing = "ease-in-out" }: { readonly duration?: number; readonly easing?: Easing } = {},
): Promise<boolean> {
  const { position, quaternion } = traveller.rig.pose;
  const keyframes = [
    { t_ms: 0, position, quaternion },
    { t_ms: Math.max(1, duration), ...to },
  ];
  return travel(traveller, cameraPath(keyframes, { easing }));
}
