/** Lists of the scene's saved views and camera paths, and functions that take the camera there. */
import { signal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { travel, travelTo } from "#viewer/control/journey";
import { type CameraPath, cameraPath, type NamedEasing } from "#viewer/movement/camera-path";
import type { TimedPose } from "#viewer/movement/movement";
import type { ViewerSession } from "#viewer/session/session";
import type { ScenePose } from "#viewer/view/camera";
import { QuietButton } from "../button";

interface Props {
  readonly places: object;
  readonly heading?: string;
  /** Tooltip of each entry. */
  readonly title: string;
  readonly onChoose: (name: string) => void;
  readonly actions?: (name: string) => ComponentChildren;
}

/** Renders nothing if there are no entries. */
export function SavedPlaces({ places, heading, title, onChoose, actions }: Props) {
  if (Object.keys(places).length === 0) return null;
  return (
    <>
      {heading && <p class="small">{heading}</p>}
      <ul class="saved-places" aria-label={heading ?? "Saved views"}>
        {Object.keys(places).map((name) => (
          <li key={name} class="row">
            <QuietButton title={title} onClick={() => onChoose(name)}>
              {name}
            </QuietButton>
            {actions?.(name)}
          </li>
        ))}
      </ul>
    </>
  );
}

/** Flies to a pose, or jumps if the user prefers reduced motion. */
export function goTo(session: ViewerSession, pose: ScenePose): void {
  if (!matchMedia("(prefers-reduced-motion: reduce)").matches) {
    void travelTo(session, pose);
    return;
  }
  session.rig.drive(null);
  session.rig.place(pose);
}

/** The visit in which a path moves the camera. */
export const playing = signal<ViewerSession | null>(null);
let journeys = 0;

interface Path {
  readonly keyframes: readonly TimedPose[];
  readonly easing?: NamedEasing;
  readonly loop?: boolean;
}

/** Plays a path, until its end or until the user moves the camera. */
export async function play(session: ViewerSession, path: Path): Promise<void> {
  const journey = ++journeys;
  playing.value = session;
  await travel(session, pathOf(path), path.loop);
  if (journey === journeys) playing.value = null;
}

export function pathOf({ keyframes, easing = "linear", loop = false }: Path): CameraPath {
  return cameraPath(keyframes, { easing, closed: loop });
}

export function presentPose({ rig }: ViewerSession): ScenePose {
  const { position, quaternion } = rig.pose;
  return { position: [...position], quaternion: [...quaternion] };
}
