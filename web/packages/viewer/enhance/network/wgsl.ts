/**
 * Writes a network as WGSL, a compute shader for each layer, with its weights as literals: they become immediate
 * operands or constants of the compiler's, and no thread loads them.
 *
 * A workgroup computes a tile of pixels and every thread all channels of one pixel. The tile's input, a pixel larger on
 * each side, is loaded once into workgroup memory for all nine taps; the picture's outermost pixels repeat beyond its
 * edge. Channels are processed in fours, as layers of a texture array and as mat4x4 × vec4. Pure.
 */
import type { Layer, Network } from "./networks";

/** A layer's shader; its textures are `source`, `result`, and for the last layer `frame`, at bindings 0, 1 and 2. */
export interface Shader {
  readonly code: string;
  /** Pixels of the frame that a workgroup computes. */
  readonly tile: readonly [width: number, height: number];
}

export type Precision = "f16" | "f32";

/**
 * The faster number format of a device. NVIDIA's compiler has no immediate operands in half precision: on an H200 the
 * shaders took up to twice as long with it (docs/results/2026-11-enhancement-cost.md).
 */
export function fasterPrecision(device: Pick<GPUDevice, "features"> & { adapterInfo?: { vendor: string } }): Precision {
  return device.features.has("shader-f16") && device.adapterInfo?.vendor !== "nvidia" ? "f16" : "f32";
}

/** Slope of leaky ReLU. */
const SLOPE = 0.1;
/** Texture format of activations and of the enhanced picture. */
export const FORMAT = "rgba16float";
/** Bytes of workgroup memory that every device has. */
const WORKGROUP_MEMORY = 16_384;
const BYTES = { f16: 8, f32: 16 };

/** The shaders of a network's layers; the numbers are in `precision`. */
export function shaders(network: Network, precision: Precision): Shader[] {
  return network.layers.map((layer, i) => {
    const last = i === network.layers.length - 1;
    return shader(layer, { first: i === 0, scale: last ? network.scale : null, precision });
  });
}

interface Place {
  readonly first: boolean;
  /** The network's scale for its last layer, else null. */
  readonly scale: 1 | 2 | null;
  readonly precision: Precision;
}

function shader(layer: Layer, { first, scale, precision }: Place): Shader {
  const groups = Math.ceil(layer.inputs / 4);
  const [width, height] = [16, (16 + 2) * (8 + 2) * groups * BYTES[precision] > WORKGROUP_MEMORY ? 4 : 8];
  const [outerWidth, outerHeight] = [width + 2, height + 2];
  const outer = outerWidth * outerHeight;
  const number = precision;
  const load = (group: number) => `textureLoad(source, at, ${first ? "" : `${group}, `}0)`;
  const code = `${precision === "f16" ? "enable f16;\n" : ""}
@group(0) @binding(0) var source: ${first ? "texture_2d" : "texture_2d_array"}<f32>;
@group(0) @binding(1) var result: ${scale === null ? "texture_storage_2d_array" : "texture_storage_2d"}<${FORMAT}, write>;
${scale === null ? "" : "@group(0) @binding(2) var frame: texture_2d<f32>;\n"}
var<workgroup> tile: array<vec4<${number}>, ${groups * outer}>;

@compute @workgroup_size(${width}, ${height})
fn main(
  @builtin(workgroup_id) workgroup: vec3<u32>,
  @builtin(local_invocation_id) local: vec3<u32>,
  @builtin(local_invocation_index) thread: u32,
) {
  let size = vec2<i32>(textureDimensions(source));
  let corner = vec2<i32>(workgroup.xy * vec2<u32>(${width}u, ${height}u));
  for (var i = thread; i < ${outer}u; i += ${width * height}u) {
    let at = clamp(corner + vec2<i32>(vec2<u32>(i % ${outerWidth}u, i / ${outerWidth}u)) - 1, vec2<i32>(0), size - 1);
${lines(groups, (group) => `    tile[i + ${group * outer}u] = vec4<${number}>(${load(group)});`)}
  }
  workgroupBarrier();
  let pixel = corner + vec2<i32>(local.xy);
  if (any(pixel >= size)) {
    return;
  }
  let own = local.y * ${outerWidth}u + local.x;
${convolution(layer, outerWidth, outer, number)}
${scale === null ? activation(layer) : picture(scale)}
}
`;
  return { code, tile: [width, height] };
}

/** Declares sum0, sum1 … and adds up the nine taps' products. */
function convolution(layer: Layer, outerWidth: number, outer: number, number: Precision): string {
  const sums = Math.ceil(layer.outputs / 4);
  const text = [
    lines(sums, (sum) => `  var sum${sum} = ${vector(layer, sum, number)};`),
    `  var value: vec4<${number}>;`,
  ];
  for (let tap = 0; tap < 9; tap++) {
    for (let group = 0; 4 * group < layer.inputs; group++) {
      const offset = group * outer + Math.floor(tap / 3) * outerWidth + (tap % 3);
      text.push(`  value = tile[own + ${offset}u];`);
      text.push(lines(sums, (sum) => `  sum${sum} += ${product(layer, sum, group, tap, number)};`));
    }
  }
  return text.join("\n");
}

function vector(layer: Layer, sum: number, number: Precision): string {
  const rows = Math.min(4, layer.outputs - 4 * sum);
  const bias = layer.bias.subarray(4 * sum, 4 * sum + rows);
  return `vec${rows}<${number}>(${Array.from(bias, literal).join(", ")})`;
}

/** Contribution of four inputs through one tap to four outputs. */
function product(layer: Layer, sum: number, group: number, tap: number, number: Precision): string {
  const { inputs, outputs, weights } = layer;
  const rows = Math.min(4, outputs - 4 * sum);
  const columns = Math.min(4, inputs - 4 * group);
  const elements = Array.from({ length: columns * rows }, (_, i) => {
    const [row, column] = [4 * sum + (i % rows), 4 * group + Math.floor(i / rows)];
    return literal(weights[(row * inputs + column) * 9 + tap] ?? 0);
  });
  return `mat${columns}x${rows}<${number}>(${elements.join(", ")}) * value${columns < 4 ? ".xyz" : ""}`;
}

function activation({ outputs }: Layer): string {
  return lines(
    outputs / 4,
    (sum) => `  textureStore(result, pixel, ${sum}, vec4<f32>(max(sum${sum}, ${SLOPE} * sum${sum})));`,
  );
}

/** Adds the frame, enlarged bilinearly, to the last layer's outputs; output c·r² + dy·r + dx is colour c of pixel (dx, dy). */
function picture(scale: 1 | 2): string {
  if (scale === 1) {
    return `  textureStore(result, pixel, vec4<f32>(saturate(${frameAt("pixel")} + vec3<f32>(sum0)), 1));`;
  }
  // The centres of the four new pixels are a quarter of an old pixel from the old centre.
  const pixels = [0, 1, 2, 3].map((i) => {
    const [dx, dy] = [i % 2, i >> 1];
    const [beside, above, across] = [3 + 2 * dx, 1 + 6 * dy, 2 * dx + 6 * dy];
    const residual = `vec3<f32>(f32(sum0[${i}]), f32(sum1[${i}]), f32(sum2[${i}]))`;
    const enlarged = `0.5625 * near4 + 0.1875 * (near${beside} + near${above}) + 0.0625 * near${across}`;
    return `  textureStore(result, 2 * pixel + vec2<i32>(${dx}, ${dy}), vec4<f32>(saturate(${enlarged} + ${residual}), 1));`;
  });
  return `${lines(9, (i) => `  let near${i} = ${frameAt(`pixel + vec2<i32>(${(i % 3) - 1}, ${Math.floor(i / 3) - 1})`)};`)}
${pixels.join("\n")}`;
}

function frameAt(position: string): string {
  return `textureLoad(frame, clamp(${position}, vec2<i32>(0), size - 1), 0).rgb`;
}

/** A half as a literal that is exactly its value in any precision; one too small to be normal, which a GPU may flush, is 0. */
function literal(half: number): string {
  const exponent = (half >> 10) & 31;
  if (exponent === 0) return "0.0";
  const fraction = ((half & 1023) << 2).toString(16).padStart(3, "0");
  return `${half >> 15 ? "-" : ""}0x1.${fraction}p${exponent - 15}`;
}

function lines(count: number, line: (i: number) => string): string {
  return Array.from({ length: count }, (_, i) => line(i)).join("\n");
}
