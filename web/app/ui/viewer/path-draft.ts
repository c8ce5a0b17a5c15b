/** A camera path that is being edited. Pure. */
import type { SavedPath } from "#client/wire/render";
import type { NamedEasing } from "#viewer/movement/camera-path";
import type { TimedPose } from "#viewer/movement/movement";
import type { ScenePose } from "#viewer/view/camera";

export interface PathDraft {
  readonly name: string;
  /** In order of time, from 0; the last one of a loop repeats the first. */
  readonly keyframes: readonly TimedPose[];
  readonly easing: NamedEasing;
  readonly loop: boolean;
}

/** Maximum number of keyframes in a path, including the last one of a loop. */
export const MAX_KEYFRAMES = 64;
/** Default time between keyframes, in milliseconds. */
const USUAL_STEP = 3000;

export function emptyPath(name: string): PathDraft {
  return { name, keyframes: [], easing: "ease-in-out", loop: false };
}

export function draftOf(name: string, { keyframes, easing = "linear", loop = false }: SavedPath): PathDraft {
  return { name, keyframes, easing, loop };
}

export function durationOf({ keyframes }: PathDraft): number {
  return keyframes.at(-1)?.t_ms ?? 0;
}

/** The keyframes that the user has added. */
export function stopsOf({ keyframes, loop }: PathDraft): readonly TimedPose[] {
  return loop ? keyframes.slice(0, -1) : keyframes;
}

/** Adds a pose at the end, at the mean time between keyframes after the last one. */
export function withStop(draft: PathDraft, pose: ScenePose): PathDraft {
  const stops = stopsOf(draft);
  const last = stops.at(-1);
  return withStops(draft, [...stops, { t_ms: last ? last.t_ms + stepOf(draft) : 0, ...pose }]);
}

export function withoutStop(draft: PathDraft, index: number): PathDraft {
  return withStops(
    draft,
    stopsOf(draft).filter((_, i) => i !== index),
  );
}

export function withLoop(draft: PathDraft, loop: boolean): PathDraft {
  return withStops({ ...draft, loop }, stopsOf(draft));
}

/** Scales the whole path to last this many milliseconds. */
export function withDuration(draft: PathDraft, duration: number): PathDraft {
  const scale = duration / durationOf(draft);
  return { ...draft, keyframes: draft.keyframes.map((keyframe) => ({ ...keyframe, t_ms: keyframe.t_ms * scale })) };
}

function withStops(draft: PathDraft, stops: readonly TimedPose[]): PathDraft {
  const start = stops[0]?.t_ms ?? 0;
  const keyframes = stops.map((stop) => ({ ...stop, t_ms: stop.t_ms - start }));
  const [first, last] = [keyframes[0], keyframes.at(-1)];
  if (draft.loop && first && last) keyframes.push({ ...first, t_ms: last.t_ms + stepOf(draft) });
  return { ...draft, keyframes };
}

/** The mean time between keyframes. */
function stepOf(draft: PathDraft): number {
  return draft.keyframes.length > 1 ? durationOf(draft) / (draft.keyframes.length - 1) : USUAL_STEP;
}
