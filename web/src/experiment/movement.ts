/**
 * Movement traces: files of camera poses with their own time stamps, the twin of `services/lab/tigas_lab/movement`. CSV with
 * the columns t_ms, x, y, z, qx, qy, qz, qw: camera to world, in a levelled frame with OpenCV's axes (y points down, along
 * gravity); lines `# key: value` say more. `docs/movement.md` describes the format. Pure.
 */
import { levelFor, orientation, type ScenePose, startCamera } from "../camera/camera";
import { add, conjugate, multiply, rotate } from "../camera/vector";
import type { SceneInfo } from "../wire";
import type { PosePoint } from "./playback";

/** `start`: begins at the origin looking along z, which is the scene's start camera. `scene`: in the scene's levelled frame. */
export const ANCHORS = ["start", "scene"] as const;
export type Anchor = (typeof ANCHORS)[number];

export interface MovementTrace {
  readonly anchor: Anchor;
  /** What the file says of itself, by key. */
  readonly metadata: ReadonlyMap<string, string>;
  /** In a levelled frame; the first at 0 ms, rotations of length one. Never empty. */
  readonly points: readonly PosePoint[];
  /** In milliseconds. */
  readonly duration: number;
}

/** Why a file is no movement, in one sentence. */
export class MovementError extends Error {}

export const MAX_BYTES = 64_000_000;
export const MAX_POINTS = 500_000;
const COLUMNS = ["t_ms", "x", "y", "z", "qx", "qy", "qz", "qw"] as const;
const NUMBER = /^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$/i;

/** Reads a movement trace. Throws MovementError. */
export function readMovement(text: string): MovementTrace {
  if (text.length > MAX_BYTES) throw new MovementError(`A movement may have ${MAX_BYTES / 1e6} MB at most.`);
  const lines = text
    .replace(/^\uFEFF/, "")
    .split(/\r\n|\n|\r/)
    .filter((line) => line.trim() !== "");
  const metadata = new Map(lines.filter(isComment).flatMap(keyAndValue));
  const anchor = ANCHORS.find((name) => name === (metadata.get("anchor") ?? "scene"));
  if (!anchor) throw new MovementError("A movement's anchor is “start” or “scene”.");
  const [header = "", ...rows] = lines.filter((line) => !isComment(line));
  const points = readRows(header, rows);
  return { anchor, metadata, points, duration: points.at(-1)?.t_ms ?? 0 };
}

/** The movement in a scene's own frame: begun at its start camera, or where it is. */
export function placed({ anchor, points }: MovementTrace, scene: Pick<SceneInfo, "camera" | "up">): PosePoint[] {
  const level = levelFor(scene.up);
  const start = startCamera(anchor === "start" ? scene : { ...scene, camera: null });
  const rotation = multiply(level, orientation(start.azimuth, 0));
  const offset = rotate(level, start.position);
  return points.map(({ t_ms, position, quaternion }) => ({
    t_ms,
    position: [...add(offset, rotate(rotation, position))],
    quaternion: [...multiply(rotation, quaternion)],
  }));
}

/** A pose of the scene's own frame in its levelled frame: what a trace anchored to the scene holds. */
export function levelled({ position, quaternion }: ScenePose, scene: Pick<SceneInfo, "up">): ScenePose {
  const toLevel = conjugate(levelFor(scene.up));
  return { position: [...rotate(toLevel, position)], quaternion: [...multiply(toLevel, quaternion)] };
}

/** The text of a movement trace, to a microsecond, a micro-unit and 1e-7 of a rotation. */
export function writeMovement({ anchor, metadata, points }: Omit<MovementTrace, "duration">): string {
  const about = new Map([...metadata, ["anchor", anchor]]);
  const comments = [...about].map(([key, value]) => `# ${key}: ${value.replace(/\s+/g, " ")}`);
  const rows = points.map(({ t_ms, position, quaternion }) =>
    [fixed(t_ms, 3), ...position.map((value) => fixed(value, 6)), ...quaternion.map((value) => fixed(value, 7))].join(),
  );
  return [...comments, COLUMNS.join(), ...rows, ""].join("\n");
}

function readRows(header: string, rows: readonly string[]): PosePoint[] {
  const names = header.split(",").map((name) => name.trim());
  const places = COLUMNS.map((name) => names.indexOf(name));
  const missing = COLUMNS.filter((_, i) => places[i] === -1);
  if (missing.length > 0) {
    throw new MovementError(`A movement needs the columns ${COLUMNS.join(", ")}; there is no ${missing.join(", ")}.`);
  }
  if (rows.length === 0) throw new MovementError("The movement has no poses.");
  if (rows.length > MAX_POINTS) throw new MovementError(`A movement may have ${MAX_POINTS} poses at most.`);
  const points: PosePoint[] = [];
  let start: number | undefined;
  for (const [index, row] of rows.entries()) {
    const cells = row.split(",");
    const [t = Number.NaN, x = 0, y = 0, z = 0, ...quaternion] = places.map((place) => number(cells[place]));
    const length = Math.hypot(...quaternion);
    start ??= t;
    const t_ms = t - start;
    if (![t, x, y, z, length].every(Number.isFinite) || cells.length !== names.length) {
      throw new MovementError(`Row ${index + 1}: a pose needs ${names.length} numbers.`);
    }
    if (length === 0) throw new MovementError(`Row ${index + 1}: the quaternion is zero, which is no rotation.`);
    if (t_ms <= (points.at(-1)?.t_ms ?? -1)) throw new MovementError(`Row ${index + 1}: t_ms must grow.`);
    points.push({
      t_ms,
      position: [x, y, z],
      quaternion: quaternion.map((value) => value / length) as ScenePose["quaternion"],
    });
  }
  return points;
}

function isComment(line: string): boolean {
  return line.startsWith("#");
}

function keyAndValue(line: string): [string, string][] {
  const [, key, value] = /^#\s*([^:]+?)\s*:\s*(.*?)\s*$/.exec(line) ?? [];
  return key === undefined || value === undefined ? [] : [[key.toLowerCase(), value]];
}

/** NaN for what is no decimal number, the empty text among it. */
function number(text = ""): number {
  return NUMBER.test(text.trim()) ? Number(text) : Number.NaN;
}

function fixed(value: number, digits: number): string {
  return String(Number(value.toFixed(digits)) + 0); // + 0 makes one zero of two
}
