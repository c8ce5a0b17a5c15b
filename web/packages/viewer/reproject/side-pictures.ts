/**
 * A picture for each side of the surround, drawn below everything else: coarse, but available in every direction. Each
 * side was rendered from its own position and is treated as a sphere around that position.
 */
import { levelFor, orientation } from "../view/camera";
import { multiply, subtract, type Vector3 } from "../view/vector";
import { Program } from "./program";
import { EVERYWHERE, SIDE } from "./shaders";
import { directionOfPixel, pixelOfDirection, product, scaling, type View } from "./view";

/** Azimuth and elevation of each, in degrees. */
const DIRECTIONS = [
  [0, 0],
  [90, 0],
  [180, 0],
  [-90, 0],
  [0, 90],
  [0, -90],
] as const;
export const SIDES: readonly number[] = [...DIRECTIONS.keys()];
/** Half of the field of view in degrees: more than 45, so that no gaps open between sides rendered from different positions. */
const HALF = 49;
/**
 * Size of the first side in pixels; each next one is a pixel larger, so that no two have the same lens: the server
 * drops a view once a newer one through the same lens is being rendered (docs/protocol.md).
 */
const SIZE = 256;

/** A side as a view to request; `up` is the scene's. */
export function sideView(side: number, position: Vector3, up: Vector3): View {
  const [azimuth, elevation] = DIRECTIONS[side] ?? DIRECTIONS[0];
  const quaternion = multiply(levelFor(up), orientation(azimuth, elevation));
  const size = SIZE + side;
  const focal = size / 2 / Math.tan((HALF * Math.PI) / 180);
  return { position, quaternion, fx: focal, fy: focal, cx: size / 2, cy: size / 2, width: size, height: size };
}

/** Share of the sphere's radius beyond which a moved camera makes a side useless. */
export const FARTHEST = 0.9;

interface Side {
  readonly texture: WebGLTexture;
  readonly view: View;
}

export class SidePictures {
  readonly #gl: WebGL2RenderingContext;
  readonly #program: Program;
  #sides: readonly Side[] = [];

  /** Uses texture unit 3. */
  constructor(gl: WebGL2RenderingContext) {
    this.#gl = gl;
    this.#program = new Program(gl, EVERYWHERE, SIDE);
    this.#program.use();
    this.#program.integer("u_side", 3);
  }

  /** Takes a picture, which is copied and replaces one of the same direction. */
  take(source: TexImageSource, view: View): void {
    const gl = this.#gl;
    const before = this.#sides.find((side) => sameDirection(side.view, view));
    const texture = before?.texture ?? gl.createTexture();
    gl.activeTexture(gl.TEXTURE3);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, source);
    gl.activeTexture(gl.TEXTURE0);
    this.#sides = [...this.#sides.filter((side) => side !== before), { texture, view }];
  }

  /** Draws them behind everything already drawn of a view; where two overlap, the one from a nearer position. */
  draw(view: View, distance: number): void {
    const gl = this.#gl;
    const program = this.#program;
    const away = ({ view: { position } }: Side) => Math.hypot(...offset(view.position, position, distance));
    const near = this.#sides.filter((side) => away(side) < FARTHEST).sort((a, b) => away(b) - away(a));
    if (near.length === 0) return;
    program.use();
    program.matrix("u_direction", product(directionOfPixel(view), scaling(1, -1, 0, view.height)));
    gl.enable(gl.DEPTH_TEST);
    gl.activeTexture(gl.TEXTURE3);
    for (const { texture, view: side } of near) {
      gl.bindTexture(gl.TEXTURE_2D, texture);
      program.vector("u_offset", offset(view.position, side.position, distance));
      program.matrix("u_to_side", product(scaling(1 / side.width, 1 / side.height), pixelOfDirection(side)));
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    }
    gl.activeTexture(gl.TEXTURE0);
  }

  clear(): void {
    for (const { texture } of this.#sides) this.#gl.deleteTexture(texture);
    this.#sides = [];
  }
}

/** The offset in radii of the sphere. */
function offset(to: Vector3, from: Vector3, radius: number): Vector3 {
  const [x, y, z] = subtract(to, from);
  return [x / radius, y / radius, z / radius];
}

function sameDirection(a: View, b: View): boolean {
  return a.quaternion.every((value, i) => value === b.quaternion[i]);
}
