/** One journey of the camera along a path, until its end or until something else moves the camera. */
import { effect, untracked } from "@preact/signals";
import { deferred } from "#client/async/deferred";
import type { CameraPath } from "../movement/camera-path";
import type { Rig } from "../view/rig";

/** Input by which the user takes the camera over. */
const INPUT = ["pointerdown", "wheel", "keydown"] as const;

export class Journey {
  /** Whether the camera has reached the end of the path; settles when the journey is over. */
  readonly arrived: Promise<boolean>;

  constructor(rig: Rig, stage: HTMLElement, path: CameraPath, loop: boolean) {
    const { promise, resolve } = deferred<boolean>();
    this.arrived = promise;
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
    rig.drive(source);
    const listening = new AbortController();
    for (const name of INPUT) {
      stage.addEventListener(name, () => rig.takeOver(), { signal: listening.signal, passive: true });
    }
    const stop = effect(() => {
      if (rig.source.value === source) return;
      untracked(() => {
        listening.abort();
        resolve(false);
      });
    });
    void promise.then(stop);
  }
}
