/** A frame as a grid of triangles that is bent by depth and drawn as another view sees it. */
import type { DepthMap } from "#client/transport/transport";
import { Program } from "./program";
import { MESH_FRAGMENT, MESH_VERTEX } from "./shaders";
import { apply, type Matrix3, product, scaling, transfer, type View } from "./view";

/** Cells of the grid on a sphere, which is smooth. */
const SPHERE = { width: 48, height: 27 };
/** Smallest cells, in pixels of the view: with smaller ones, triangles cost more than they improve (0.1 dB at most, on recorded heads). */
const CELL = 8;
/** Geometry nearer than the frame's nearest depth by more than this factor is not drawn. */
const APPROACH = 16;

export class Mesh {
  readonly #gl: WebGL2RenderingContext;
  readonly #program: Program;
  readonly #codes: WebGLTexture;
  #depth: Omit<DepthMap, "codes"> | null = null;

  /** Uses two texture units, the first of them for the frame. */
  constructor(gl: WebGL2RenderingContext) {
    this.#gl = gl;
    this.#program = new Program(gl, MESH_VERTEX, MESH_FRAGMENT);
    this.#program.use();
    this.#program.integer("u_frame", 0);
    this.#program.integer("u_depth", 1);
    this.#codes = gl.createTexture();
    gl.activeTexture(gl.TEXTURE1);
    gl.bindTexture(gl.TEXTURE_2D, this.#codes);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.R8, 1, 1, 0, gl.RED, gl.UNSIGNED_BYTE, new Uint8Array(1));
    gl.activeTexture(gl.TEXTURE0);
  }

  /** Sets the depth of the frame to draw; null if it is unknown. */
  bend(depth: DepthMap | null): void {
    this.#depth = depth;
    if (depth === null) return;
    const gl = this.#gl;
    const { width, height, codes } = depth;
    gl.activeTexture(gl.TEXTURE1);
    gl.bindTexture(gl.TEXTURE_2D, this.#codes);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.R8, width, height, 0, gl.RED, gl.UNSIGNED_BYTE, codes);
    gl.activeTexture(gl.TEXTURE0);
  }

  /** The largest inverse depth (1/z) in the frame; pixels without depth are at the given inverse distance. */
  nearest(inverseDistance: number): number {
    return this.#depth?.nearest ?? inverseDistance;
  }

  /** Draws the frame in texture unit 0, with a depth test; `quick`: less sharply. */
  draw(frame: View, view: View, inverseDistance: number, quick: boolean): void {
    const gl = this.#gl;
    const program = this.#program;
    const step = frame.fx / view.fx;
    const cells = this.#depth ?? SPHERE;
    const width = fitting(cells.width, frame.width / step);
    const height = fitting(cells.height, frame.height / step);
    const nearest = this.nearest(inverseDistance);
    const { turn, shift } = transfer(frame, view);
    const toClip = clipOfPixel(view);
    const toPixel = scaling(frame.width, frame.height);
    program.use();
    program.matrix("u_turn", product(toClip, product(turn, toPixel)));
    program.vector("u_shift", apply(toClip, shift));
    program.matrix("u_ray", product(rayOfPixel(frame), toPixel));
    program.numbers("u_cells", width, height);
    program.integer("u_has_depth", this.#depth === null ? 0 : 1);
    program.number("u_nearest", nearest);
    program.number("u_limit", APPROACH * nearest || 1);
    program.number("u_step", step);
    program.integer("u_quick", quick ? 1 : 0);
    gl.enable(gl.DEPTH_TEST);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 2 * (width + 2), height + 1);
  }
}

function fitting(cells: number, pixels: number): number {
  return Math.max(1, Math.min(cells, Math.round(pixels / CELL)));
}

/** From [u, v, 1] to x, y and w in clip space, with y up. */
function clipOfPixel({ width, height }: View): Matrix3 {
  return scaling(2 / width, -2 / height, -1, 1);
}

function rayOfPixel({ fx, fy, cx, cy }: View): Matrix3 {
  return scaling(1 / fx, 1 / fy, -cx / fx, -cy / fy);
}
