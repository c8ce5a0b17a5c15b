/** A compiled pair of WebGL2 shaders and its uniforms by name. */
import type { Vector3 } from "../view/vector";
import type { Matrix3 } from "./view";

export class Program {
  readonly #gl: WebGL2RenderingContext;
  readonly #program: WebGLProgram;
  readonly #locations = new Map<string, WebGLUniformLocation | null>();

  /** Throws an Error if the graphics processor's driver refuses the shaders. */
  constructor(gl: WebGL2RenderingContext, vertex: string, fragment: string) {
    this.#gl = gl;
    this.#program = gl.createProgram();
    const shaders = [shader(gl, gl.VERTEX_SHADER, vertex), shader(gl, gl.FRAGMENT_SHADER, fragment)];
    for (const compiled of shaders) gl.attachShader(this.#program, compiled);
    gl.linkProgram(this.#program);
    for (const compiled of shaders) gl.deleteShader(compiled);
    if (!gl.getProgramParameter(this.#program, gl.LINK_STATUS)) {
      const why =
        shaders.map((compiled) => gl.getShaderInfoLog(compiled)).join("") || gl.getProgramInfoLog(this.#program);
      throw new Error(`shaders cannot be used: ${why}`);
    }
  }

  use(): void {
    // biome-ignore lint/correctness/useHookAtTopLevel: it is WebGL's, not a hook
    this.#gl.useProgram(this.#program);
  }

  /** These set uniforms of the program in use. */
  matrix(name: string, value: Matrix3): void {
    this.#gl.uniformMatrix3fv(this.#location(name), true, value);
  }

  vector(name: string, value: Vector3): void {
    this.#gl.uniform3fv(this.#location(name), value);
  }

  numbers(name: string, ...values: readonly [number, number]): void {
    this.#gl.uniform2fv(this.#location(name), values);
  }

  number(name: string, value: number): void {
    this.#gl.uniform1f(this.#location(name), value);
  }

  integer(name: string, value: number): void {
    this.#gl.uniform1i(this.#location(name), value);
  }

  integers(name: string, ...values: readonly [number, number]): void {
    this.#gl.uniform2iv(this.#location(name), values);
  }

  #location(name: string): WebGLUniformLocation | null {
    let location = this.#locations.get(name);
    if (location === undefined) {
      location = this.#gl.getUniformLocation(this.#program, name);
      this.#locations.set(name, location);
    }
    return location;
  }
}

function shader(gl: WebGL2RenderingContext, type: GLenum, source: string): WebGLShader {
  const made = gl.createShader(type);
  if (made === null) throw new Error("the graphics processor was lost");
  gl.shaderSource(made, source);
  gl.compileShader(made);
  return made;
}
