/** The seen part of all directions on a coarse grid, as shown by the page's warp: marks the rendered ones. */
import { FACES, FAR } from "#viewer/reproject/cube-cache";
import { FARTHEST } from "#viewer/reproject/side-pictures";
import { apply, directionOfPixel, pixelOfDirection, type View } from "#viewer/reproject/view";
import { add, subtract, type Vector3 } from "#viewer/view/vector";

/** Grid sizes of a side of the cube, and of a view. */
const TEXELS = 16;
const COLUMNS = 32;
const ROWS = 18;

export class Seen {
  readonly #distance: number;
  readonly #cube = FACES.flatMap((face) => {
    const middles = Array.from({ length: TEXELS }, (_, i) => (2 * i + 1) / TEXELS - 1);
    return middles.flatMap((t) => middles.map((s) => ({ direction: apply(face, [s, t, 1]), seen: false })));
  });
  #origin: Vector3 | undefined;
  #frame: View | undefined;

  /** `distance` is how far away everything is, in scene units. */
  constructor(distance: number) {
    this.#distance = distance;
  }

  /** The newest frame, with its margins. */
  take(frame: View): void {
    this.#frame = frame;
    const forgotten = this.#origin && Math.hypot(...subtract(frame.position, this.#origin)) > FAR * this.#distance;
    if (forgotten || this.#origin === undefined) this.#origin = frame.position;
    const toPixel = pixelOfDirection(frame);
    for (const texel of this.#cube) {
      texel.seen = (texel.seen && !forgotten) || shows(frame, apply(toPixel, texel.direction));
    }
  }

  /** The share of a view that was not rendered, given these `sides`. */
  never(view: View, sides: Iterable<View>): number {
    const frame = this.#frame;
    const toDirection = directionOfPixel(view);
    const spheres = [...sides].map((side) => ({
      side,
      toPixel: pixelOfDirection(side),
      ...this.#seenFrom(side, view),
    }));
    const newest = frame && { toPixel: pixelOfDirection(frame), ...this.#seenFrom(frame, view) };
    let never = 0;
    for (let row = 0; row < ROWS; row++) {
      for (let column = 0; column < COLUMNS; column++) {
        const pixel: Vector3 = [((column + 0.5) / COLUMNS) * view.width, ((row + 0.5) / ROWS) * view.height, 1];
        const direction = unit(apply(toDirection, pixel));
        if (frame && newest && shows(frame, apply(newest.toPixel, onSphere(direction, newest.offset)))) continue;
        const there = spheres.some(
          ({ side, toPixel, offset, away }) =>
            away < FARTHEST && shows(side, apply(toPixel, onSphere(direction, offset))),
        );
        if (!there && !this.#wasSeen(direction)) never++;
      }
    }
    return never / (ROWS * COLUMNS);
  }

  /** Position of a view on the unit sphere around a picture's position. */
  #seenFrom(picture: View, view: View) {
    const [x, y, z] = subtract(view.position, picture.position);
    const offset: Vector3 = [x / this.#distance, y / this.#distance, z / this.#distance];
    return { offset, away: Math.hypot(...offset) };
  }

  #wasSeen(direction: Vector3): boolean {
    const [x, y, z] = direction.map(Math.abs) as [number, number, number];
    const axis = x >= y && x >= z ? 0 : y >= z ? 1 : 2;
    const number = 2 * axis + (direction[axis] < 0 ? 1 : 0);
    const face = FACES[number];
    if (face === undefined) return false;
    const long = Math.abs(direction[axis]);
    // The face's columns are at right angles and 1 long, so its transpose takes a direction to (s, t, 1).
    const s = (face[0] * direction[0] + face[3] * direction[1] + face[6] * direction[2]) / long;
    const t = (face[1] * direction[0] + face[4] * direction[1] + face[7] * direction[2]) / long;
    const at = (value: number) => Math.min(TEXELS - 1, Math.floor(((value + 1) / 2) * TEXELS));
    return this.#cube[(number * TEXELS + at(t)) * TEXELS + at(s)]?.seen === true;
  }
}

function shows({ width, height }: View, [x, y, ahead]: Vector3): boolean {
  return ahead > 0 && x >= 0 && y >= 0 && x <= width * ahead && y <= height * ahead;
}

/** The point of the unit sphere that is seen from a position inside it, or from outside, as if it were infinitely large. */
function onSphere(direction: Vector3, offset: Vector3): Vector3 {
  const along = direction[0] * offset[0] + direction[1] * offset[1] + direction[2] * offset[2];
  const root = along * along + 1 - offset[0] ** 2 - offset[1] ** 2 - offset[2] ** 2;
  if (root <= 0) return direction;
  const reach = Math.sqrt(root) - along;
  return add(offset, [reach * direction[0], reach * direction[1], reach * direction[2]]);
}

function unit([x, y, z]: Vector3): Vector3 {
  const length = Math.hypot(x, y, z);
  return [x / length, y / length, z / length];
}
