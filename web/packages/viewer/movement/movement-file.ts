/**
 * Files of movements, as CSV. `tigas_experiments/movement` accepts and refuses the same texts. `docs/experiments.md`
 * describes the format: columns t_ms, x, y, z, qx, qy, qz, qw; camera to world, in a levelled frame with OpenCV's axes
 * (y points down, along gravity); lines `# key: value` before the header. Pure.
 */
import { ANCHORS, COLUMNS, MAX_COORDINATE, MAX_DURATION_MS, QUATERNION_LENGTHS, UNITS } from "#client/wire/movement";
import type { ScenePose } from "../view/camera";
import { MAX_POINTS, MovementError, type MovementTrace, type TimedPose } from "./movement";

/** Less than `tigas` reads, because a page may be on a phone. */
export const MAX_BYTES = 64_000_000;
const MAX_LINE = 10_000;
/** Extensions of other files that users drop on the page. */
const SCENE_FILE = /\.(ply|splat|spz|sog)$/i;
const NUMBER = /^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$/i;

/** Reads the text of a file, which messages call `name`. Throws MovementError. */
export function readMovement(text: string, name = "The movement"): MovementTrace {
  if (text.length > MAX_BYTES) throw new MovementError(tooLarge(name));
  if (text.includes("\0")) throw new MovementError(binary(name));
  const lines = contentOf(text, name);
  const comments = new Map<string, string>();
  for (const [, line] of lines) {
    if (!line.startsWith("#")) {
      const columns = line.split(",").map((column) => column.trim());
      const anchor = take(comments, "anchor", ANCHORS, name);
      const unit = take(comments, "unit", UNITS, name);
      if (anchor === "scene" && unit === "m") {
        throw new MovementError(
          `${name}: “anchor: scene” is in the scene's own unit; only “anchor: start” may be in m.`,
        );
      }
      const points = readPoints(lines, columns, name);
      return { anchor, unit, comments, points, duration: points.at(-1)?.t_ms ?? 0 };
    }
    const [, key, value] = /^[# ]*([^:]*):(.*)$/.exec(line) ?? [];
    if (key !== undefined && value !== undefined) comments.set(key.trim(), value.trim());
  }
  throw new MovementError(`${name} is empty.`);
}

/** Reads a file that the user chose. Throws MovementError. */
export async function readMovementFile(file: File): Promise<MovementTrace> {
  if (SCENE_FILE.test(file.name)) {
    throw new MovementError(
      `${file.name} is a scene, not a movement: put it into the server's models directory, then rescan the list of scenes.`,
    );
  }
  if (file.size > MAX_BYTES) throw new MovementError(tooLarge(file.name));
  let bytes: ArrayBuffer;
  try {
    bytes = await file.arrayBuffer();
  } catch {
    throw new MovementError(`${file.name} cannot be read.`);
  }
  let text: string;
  try {
    text = new TextDecoder("utf-8", { fatal: true }).decode(bytes);
  } catch {
    throw new MovementError(binary(file.name));
  }
  return readMovement(text, file.name);
}

/** The text of a file: microseconds, and six decimals of everything else. */
export function writeMovement({ anchor, unit, comments, points }: MovementTrace): string {
  const said = [["anchor", anchor] as const, ["unit", unit] as const, ...comments];
  const head = said.map(([key, value]) => `# ${key}: ${value.trim().replace(/\s+/g, " ")}`);
  const rows = points.map(({ t_ms, position, quaternion }) =>
    [rounded(t_ms, 3), ...[...position, ...quaternion].map((value) => rounded(value, 6))].join(),
  );
  return [...head, COLUMNS.join(), ...rows, ""].join("\n");
}

type Line = readonly [number: number, content: string];

/** The non-blank lines, with their numbers. */
function contentOf(text: string, name: string): Line[] {
  const lines: Line[] = [];
  for (const [index, line] of text
    .replace(/^\uFEFF/, "")
    .split("\n")
    .entries()) {
    if (line.length > MAX_LINE)
      throw new MovementError(`${name}, line ${index + 1} is longer than ${MAX_LINE} characters.`);
    const content = line.trim();
    if (content !== "") lines.push([index + 1, content]);
  }
  return lines;
}

function readPoints(lines: readonly Line[], columns: readonly string[], name: string): TimedPose[] {
  if (columns.includes("ViewIndex")) {
    throw new MovementError(`${name} is a recording of EyeNavGS; convert it with “tigas movement import”.`);
  }
  const twice = columns.find((column, index) => columns.indexOf(column) !== index);
  if (twice !== undefined) throw new MovementError(`${name} has the column “${twice.slice(0, 40)}” twice.`);
  const missing = COLUMNS.find((column) => !columns.includes(column));
  if (missing) throw new MovementError(`${name} has no column “${missing}”; it needs ${COLUMNS.join(", ")}.`);
  const places = COLUMNS.map((column) => columns.indexOf(column));
  const [, ...rows] = lines.filter(([, content]) => !content.startsWith("#"));
  if (rows.length === 0) throw new MovementError(`${name} has no poses.`);
  if (rows.length > MAX_POINTS) throw new MovementError(`${name} has more than ${MAX_POINTS} rows.`);
  const points: TimedPose[] = [];
  let start: number | undefined;
  for (const [line, content] of rows) {
    const refuse = (what: string) => new MovementError(`${name}, line ${line}: the row ${what}.`);
    const cells = content.split(",");
    const values = places.map((place) => number(cells[place]));
    const wrong = values.findIndex((value) => !Number.isFinite(value));
    if (wrong !== -1) throw refuse(`needs a number as ${COLUMNS[wrong]}`);
    const [t = 0, x = 0, y = 0, z = 0, ...quaternion] = values;
    start ??= t;
    const t_ms = t - start;
    const before = points.at(-1)?.t_ms ?? -1;
    if (t_ms < before) throw refuse("is earlier than the previous one");
    if (t_ms > MAX_DURATION_MS) throw refuse("is more than a day after the first");
    if (Math.max(...[x, y, z].map(Math.abs)) > MAX_COORDINATE) throw refuse("is farther away than a million");
    const length = Math.hypot(...quaternion);
    if (length < QUATERNION_LENGTHS[0] || length > QUATERNION_LENGTHS[1]) {
      throw refuse("has a quaternion that is not a rotation: its length is not 1");
    }
    if (t_ms === before) continue; // recorders occasionally repeat a row
    const unit = quaternion.map((value) => value / length) as ScenePose["quaternion"];
    points.push({ t_ms, position: [x, y, z], quaternion: unit });
  }
  return points;
}

/** The values of both keys in the comments, which are removed from the metadata; the scene's by default. */
function take<T extends string>(comments: Map<string, string>, key: string, known: readonly T[], name: string): T {
  const value = comments.get(key) ?? "scene";
  comments.delete(key);
  const choice = known.find((one) => one === value);
  if (choice === undefined) {
    throw new MovementError(`${name}: its ${key} is “${value.slice(0, 30)}”, and not ${known.join(" or ")}.`);
  }
  return choice;
}

function binary(name: string): string {
  return `${name} is binary, not the text of a movement.`;
}

function tooLarge(name: string): string {
  return `${name} is larger than ${MAX_BYTES / 1e6} MB, the most that this page reads.`;
}

/** NaN for anything but a decimal number, including empty text. */
function number(text = ""): number {
  return NUMBER.test(text.trim()) ? Number(text) : Number.NaN;
}

function rounded(value: number, digits: number): number {
  return Number(value.toFixed(digits)) + 0; // + 0 turns -0 into 0
}
