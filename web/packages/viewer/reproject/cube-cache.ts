/**
 * Cache of previously seen surroundings, on the sides of a small cube: it fills the view where the newest frame has no
 * pixels. Frames are projected by rotation alone, newer over older. Once the camera has moved a share of the scene's
 * distance from the cube's centre, its contents would appear displaced, and the cube is cleared.
 */
import { add, subtract, type Vector3 } from "../view/vector";
import { Program } from "./program";
import { EVERYWHERE, FILL, KEEP } from "./shaders";
import {
  apply,
  directionOfPixel,
  type Matrix3,
  pixelOfDirection,
  product,
  scaling,
  transposed,
  type View,
} from "./view";

/** From [s, t, 1] on a side, -1 to 1 each, to a direction. OpenGL ES 3.0, table 3.19. */
export const FACES: readonly Matrix3[] = [
  [0, 0, 1, 0, -1, 0, -1, 0, 0],
  [0, 0, -1, 0, -1, 0, 1, 0, 0],
  [1, 0, 0, 0, 0, 1, 0, 1, 0],
  [1, 0, 0, 0, 0, -1, 0, -1, 0],
  [1, 0, 0, 0, -1, 0, 0, 0, 1],
  [-1, 0, 0, 0, -1, 0, 0, 0, -1],
];

/** The sides, by number, that a view can touch; sometimes one too many. */
export function facesSeen(view: View): readonly number[] {
  const { width, height } = view;
  const toDirection = directionOfPixel(view);
  const toPixel = pixelOfDirection(view);
  const corners = [0, width].flatMap((u) => [0, height].map((v) => apply(toDirection, [u, v, 1])));
  const bounds = planes(rowsOf(product(scaling(2 / width, 2 / height, -1, -1), toPixel)));
  return [...FACES.keys()].filter((index) => {
    const face = FACES[index] as Matrix3;
    const edges = [-1, 1].flatMap((s) => [-1, 1].map((t) => apply(face, [s, t, 1])));
    const apart = (normal: Vector3, directions: readonly Vector3[]) => directions.every((one) => dot(normal, one) <= 0);
    return (
      !planes(rowsOf(transposed(face))).some((side) => apart(side, corners)) &&
      !bounds.some((side) => apart(side, edges))
    );
  });
}

/** The inward normals of the four planes that bound x / ahead and y / ahead to -1 to 1. */
function planes([x, y, ahead]: readonly [Vector3, Vector3, Vector3]): readonly Vector3[] {
  return [add(ahead, x), subtract(ahead, x), add(ahead, y), subtract(ahead, y)];
}

function rowsOf([a, b, c, d, e, f, g, h, i]: Matrix3): [Vector3, Vector3, Vector3] {
  return [
    [a, b, c],
    [d, e, f],
    [g, h, i],
  ];
}

function dot(a: Vector3, b: Vector3): number {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/** Width of a side in pixels. */
const SIZE = 512;
/**
 * Share of the scene's distance: at this one, points abeam of the camera are displaced by a quarter of their distance
 * (14°).
 */
export const FAR = 0.25;

export class CubeCache {
  readonly #gl: WebGL2RenderingContext;
  readonly #texture: WebGLTexture;
  readonly #target: WebGLFramebuffer;
  readonly #keep: Program;
  readonly #fill: Program;
  /** Position of its centre; null while it is empty. */
  #origin: Vector3 | null = null;

  /** Uses texture unit 0 for the frame and 2 for the cube. */
  constructor(gl: WebGL2RenderingContext) {
    this.#gl = gl;
    this.#keep = new Program(gl, EVERYWHERE, KEEP);
    this.#keep.use();
    this.#keep.integer("u_frame", 0);
    this.#fill = new Program(gl, EVERYWHERE, FILL);
    this.#fill.use();
    this.#fill.integer("u_cube", 2);
    this.#texture = gl.createTexture();
    gl.activeTexture(gl.TEXTURE2);
    gl.bindTexture(gl.TEXTURE_CUBE_MAP, this.#texture);
    gl.texParameteri(gl.TEXTURE_CUBE_MAP, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
    gl.texStorage2D(gl.TEXTURE_CUBE_MAP, 1, gl.RGBA8, SIZE, SIZE);
    gl.activeTexture(gl.TEXTURE0);
    this.#target = gl.createFramebuffer();
  }

  /** Adds the frame in texture unit 0. */
  add(frame: View, distance: number): void {
    const gl = this.#gl;
    if (this.#origin && Math.hypot(...subtract(frame.position, this.#origin)) > FAR * distance) this.clear();
    this.#origin ??= frame.position;
    gl.disable(gl.DEPTH_TEST);
    this.#keep.use();
    this.#keep.number("u_step", (frame.fx * 2) / SIZE);
    const toFrame = product(scaling(1 / frame.width, 1 / frame.height), pixelOfDirection(frame));
    for (const face of facesSeen(frame)) {
      this.#aim(face);
      const side = product(FACES[face] as Matrix3, scaling(2 / SIZE, 2 / SIZE, -1, -1));
      this.#keep.matrix("u_to_frame", product(toFrame, side));
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  /** Draws it behind everything already drawn of a view. */
  draw(view: View): void {
    if (this.#origin === null) return;
    const gl = this.#gl;
    this.#fill.use();
    this.#fill.matrix("u_direction", product(directionOfPixel(view), scaling(1, -1, 0, view.height)));
    gl.enable(gl.DEPTH_TEST);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  clear(): void {
    if (this.#origin === null) return;
    const gl = this.#gl;
    this.#origin = null;
    gl.clearColor(0, 0, 0, 0);
    for (const face of FACES.keys()) {
      this.#aim(face);
      gl.clear(gl.COLOR_BUFFER_BIT);
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  #aim(face: number): void {
    const gl = this.#gl;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.#target);
    const side = gl.TEXTURE_CUBE_MAP_POSITIVE_X + face;
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, side, this.#texture, 0);
    gl.viewport(0, 0, SIZE, SIZE);
  }
}
