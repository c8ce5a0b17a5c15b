/**
 * Scales a picture to the displayed size like Pillow's `resize`: across, then down, with a filter that is widened where the picture
 * is reduced (so it does not alias) and cut off at the border, and with values kept between black and white after each step.
 * Bicubic is Catmull-Rom's (a = -0.5), Lanczos has three lobes.
 */
import type { Sampling } from "./geometry";
import type { Filter } from "./model/enhancer";

const SHADER = /* wgsl */ `
struct Sampling { origin: f32, step: f32, length: i32 }
@group(0) @binding(0) var picture: texture_2d<f32>;
@group(0) @binding(1) var<uniform> sampling: Sampling;
override DOWN: bool;
override LANCZOS: bool;

fn sinc(x: f32) -> f32 {
  let t = 3.14159265358979 * x;
  return select(sin(t) / t, 1.0, t == 0.0);
}

fn weight(x: f32) -> f32 {
  let t = abs(x);
  if (LANCZOS) {
    return select(0.0, sinc(t) * sinc(t / 3.0), t < 3.0);
  }
  if (t < 1.0) {
    return (1.5 * t - 2.5) * t * t + 1.0;
  }
  return select(0.0, ((-0.5 * t + 2.5) * t - 4.0) * t + 2.0, t < 2.0);
}

@vertex fn corner(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
  return vec4f(select(-1.0, 3.0, index == 1u), select(-1.0, 3.0, index == 2u), 0.0, 1.0);
}

@fragment fn resample(@builtin(position) at: vec4f) -> @location(0) vec4f {
  let here = vec2i(at.xy);
  let widened = max(sampling.step, 1.0);
  let support = select(2.0, 3.0, LANCZOS) * widened;
  let center = sampling.origin + (f32(select(here.x, here.y, DOWN)) + 0.5) * sampling.step;
  let first = max(i32(floor(center - support + 0.5)), 0);
  let end = min(i32(floor(center + support + 0.5)), sampling.length);
  var sum = vec4f();
  for (var i = first; i < end; i++) {
    let texel = textureLoad(picture, select(vec2i(i, here.y), vec2i(here.x, i), DOWN), 0);
    sum += vec4f(texel.rgb, 1.0) * weight((f32(i) + 0.5 - center) / widened);
  }
  return vec4f(clamp(sum.rgb / sum.a, vec3f(), vec3f(1.0)), 1.0);
}
`;

export type Direction = "across" | "down";

export class Resampler {
  readonly #device: GPUDevice;
  readonly #module: GPUShaderModule;
  readonly #layout: GPUBindGroupLayout;
  readonly #pipelines = new Map<string, GPURenderPipeline>();

  constructor(device: GPUDevice) {
    this.#device = device;
    this.#module = device.createShaderModule({ label: "resampler", code: SHADER });
    this.#layout = device.createBindGroupLayout({
      entries: [
        { binding: 0, visibility: GPUShaderStage.FRAGMENT, texture: { sampleType: "unfilterable-float" } },
        { binding: 1, visibility: GPUShaderStage.FRAGMENT, buffer: {} },
      ],
    });
  }

  /** A buffer for `encode`. */
  sampling(): GPUBuffer {
    return this.#device.createBuffer({ size: 16, usage: GPUBufferUsage.UNIFORM | GPUBufferUsage.COPY_DST });
  }

  write(buffer: GPUBuffer, { origin, step, length }: Sampling): void {
    const data = new DataView(new ArrayBuffer(16));
    data.setFloat32(0, origin, true);
    data.setFloat32(4, step, true);
    data.setInt32(8, length, true);
    this.#device.queue.writeBuffer(buffer, 0, data);
  }

  /** Encodes one step: from `picture` into the whole of `target`. */
  encode(
    encoder: GPUCommandEncoder,
    filter: Filter,
    direction: Direction,
    picture: GPUTexture,
    sampling: GPUBuffer,
    target: GPUTexture,
    timestampWrites?: GPURenderPassTimestampWrites,
  ): void {
    const pass = encoder.beginRenderPass({
      colorAttachments: [{ view: target.createView(), loadOp: "clear", storeOp: "store" }],
      ...(timestampWrites && { timestampWrites }),
    });
    pass.setPipeline(this.#pipeline(filter, direction, target.format));
    const entries = [
      { binding: 0, resource: picture.createView() },
      { binding: 1, resource: { buffer: sampling } },
    ];
    pass.setBindGroup(0, this.#device.createBindGroup({ layout: this.#layout, entries }));
    pass.draw(3);
    pass.end();
  }

  #pipeline(filter: Filter, direction: Direction, format: GPUTextureFormat): GPURenderPipeline {
    const key = `${filter} ${direction} ${format}`;
    const made = this.#pipelines.get(key) ?? this.#make(filter, direction, format);
    this.#pipelines.set(key, made);
    return made;
  }

  #make(filter: Filter, direction: Direction, format: GPUTextureFormat): GPURenderPipeline {
    return this.#device.createRenderPipeline({
      label: `resampler, ${filter}, ${direction}`,
      layout: this.#device.createPipelineLayout({ bindGroupLayouts: [this.#layout] }),
      vertex: { module: this.#module, entryPoint: "corner" },
      fragment: {
        module: this.#module,
        entryPoint: "resample",
        targets: [{ format }],
        constants: { DOWN: Number(direction === "down"), LANCZOS: Number(filter === "lanczos") },
      },
    });
  }
}
