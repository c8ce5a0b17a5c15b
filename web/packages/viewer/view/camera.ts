/**
 * The camera as moved by the user: upright, in a levelled frame with the y axis pointing down and the x-z plane as the
 * floor. A scene's own frame may be tilted; `Level` converts between the two. Axes are OpenCV's: x right, y down, z
 * forward.
 */
import type { SceneInfo } from "#client/wire/render";
import {
  add,
  angleBetween,
  conjugate,
  multiply,
  type Quaternion,
  rotate,
  rotationBetween,
  subtract,
  type Vector3,
} from "./vector";

/** Degrees between two samples; no user turns this fast. */
const FARTHEST_TURN = 30;
/** Movement between two samples, as a share of the distance of the focus. */
const FARTHEST_MOVE = 0.3;

/** Whether the camera jumped between two samples; `distance` of the focus is in scene units. */
export function isCut(before: ScenePose, after: ScenePose, distance: number): boolean {
  return (
    angleBetween(before.quaternion, after.quaternion) > FARTHEST_TURN ||
    Math.hypot(...subtract(after.position, before.position)) > FARTHEST_MOVE * distance
  );
}

export interface Camera {
  /** The camera's centre in the levelled frame, in scene units. */
  readonly position: Vector3;
  /** Degrees, positive to the right; 0 looks along z. */
  readonly azimuth: number;
  /** Degrees, positive upwards. */
  readonly elevation: number;
}

/** A camera-to-world transform in the scene's own frame, as sent to the server. */
export interface ScenePose {
  readonly position: [number, number, number];
  readonly quaternion: [number, number, number, number];
}

/** The rotation from the levelled frame to the scene's own. */
export type Level = Quaternion;

/** How far up or down one can look, in degrees: straight up, the azimuth would be meaningless. */
export const MAX_ELEVATION = 89;
/** Distance of the focus in a scene without a start camera. */
const UNKNOWN_DISTANCE = 4;
const RADIAN = Math.PI / 180;

export function levelFor(up: Vector3): Level {
  return rotationBetween([0, -1, 0], up);
}

/** The quaternion of R = Ry(azimuth) · Rx(elevation), in the levelled frame. */
export function orientation(azimuth: number, elevation: number): Quaternion {
  const a = (azimuth * RADIAN) / 2;
  const e = (elevation * RADIAN) / 2;
  return multiply([0, Math.sin(a), 0, Math.cos(a)], [Math.sin(e), 0, 0, Math.cos(e)]);
}

/** The pose to send. Rounded to a micro-unit, so that a request stays small and equal views are equal text. */
export function toScene(camera: Camera, level: Level): ScenePose {
  const [px, py, pz] = rotate(level, camera.position);
  const [qx, qy, qz, qw] = multiply(level, orientation(camera.azimuth, camera.elevation));
  return { position: [micro(px), micro(py), micro(pz)], quaternion: [micro(qx), micro(qy), micro(qz), micro(qw)] };
}

/** The upright camera with the view of a pose in the scene's own frame; a roll is lost. */
export function fromScene({ position, quaternion }: ScenePose, level: Level): Camera {
  const toLevel = conjugate(level);
  return { position: rotate(toLevel, position), ...towards(rotate(multiply(toLevel, quaternion), [0, 0, 1])) };
}

/** The camera with which a visitor enters the scene: its start camera, or the origin looking along z if it has none. */
export function startCamera(scene: Pick<SceneInfo, "camera" | "up">): Camera {
  if (scene.camera === null) return { position: [0, 0, 0], azimuth: 0, elevation: 0 };
  const toLevel = conjugate(levelFor(scene.up));
  const position = rotate(toLevel, scene.camera.position);
  return { position, ...towards(subtract(rotate(toLevel, scene.camera.look_at), position)) };
}

/** Distance of the start camera's focus in scene units, as a measure of the scene's size. */
export function viewDistance({ camera }: Pick<SceneInfo, "camera">): number {
  return camera === null ? UNKNOWN_DISTANCE : Math.hypot(...subtract(camera.position, camera.look_at));
}

/** Turns by degrees to the right and upwards. */
export function turn(camera: Camera, right: number, up: number): Camera {
  const azimuth = camera.azimuth + right;
  return {
    ...camera,
    azimuth: azimuth - 360 * Math.round(azimuth / 360),
    elevation: clampElevation(camera.elevation + up),
  };
}

/** Turns by degrees about a point of the levelled frame, which stays where it is in the picture. */
export function orbit(camera: Camera, pivot: Vector3, right: number, up: number): Camera {
  const turned = turn(camera, right, up);
  const seen = seenFrom(camera, pivot);
  return { ...turned, position: subtract(pivot, rotate(orientation(turned.azimuth, turned.elevation), seen)) };
}

/** A point of the levelled frame relative to the camera: to its right, below it and in front of it, in scene units. */
export function seenFrom({ position, azimuth, elevation }: Camera, point: Vector3): Vector3 {
  return rotate(conjugate(orientation(azimuth, elevation)), subtract(point, position));
}

/** The point straight ahead at a distance. */
export function ahead({ position, azimuth, elevation }: Camera, distance: number): Vector3 {
  return add(position, rotate(orientation(azimuth, elevation), [0, 0, distance]));
}

/** Moves halfway to a point of the levelled frame, which is then in the middle of the picture. */
export function approach({ position }: Camera, point: Vector3): Camera {
  const way = subtract(point, position);
  return { position: add(position, [way[0] / 2, way[1] / 2, way[2] / 2]), ...towards(way) };
}

/** Interpolates between two cameras: 0 is the first, 1 the second. */
export function between(from: Camera, to: Camera, share: number): Camera {
  const way = subtract(to.position, from.position);
  const around = to.azimuth - from.azimuth;
  const turned = turn(from, share * (around - 360 * Math.round(around / 360)), share * (to.elevation - from.elevation));
  return { ...turned, position: add(from.position, [share * way[0], share * way[1], share * way[2]]) };
}

/** Moves by scene units, level with the floor and relative to where the camera faces. */
export function move(camera: Camera, forward: number, right: number, up: number): Camera {
  const sin = Math.sin(camera.azimuth * RADIAN);
  const cos = Math.cos(camera.azimuth * RADIAN);
  return {
    ...camera,
    position: add(camera.position, [sin * forward + cos * right, -up, cos * forward - sin * right]),
  };
}

/** The angles of a camera that looks along a direction of the levelled frame. */
function towards([x, y, z]: Vector3): Pick<Camera, "azimuth" | "elevation"> {
  return {
    azimuth: Math.atan2(x, z) / RADIAN,
    elevation: clampElevation(Math.atan2(-y, Math.hypot(x, z)) / RADIAN),
  };
}

function clampElevation(elevation: number): number {
  return Math.min(MAX_ELEVATION, Math.max(-MAX_ELEVATION, elevation));
}

function micro(value: number): number {
  return Math.round(value * 1e6) / 1e6 + 0; // + 0 turns -0 into 0
}
