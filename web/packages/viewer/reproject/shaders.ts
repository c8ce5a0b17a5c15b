/** The shaders of the warp. Textures have the picture's top row first, so v grows downwards like y in a view. */

const HEAD = `#version 300 es
precision highp float;
precision highp int;
`;

/** One triangle over the whole target, at the far end of the depth range. */
export const EVERYWHERE = `${HEAD}
void main() {
  gl_Position = vec4(4.0 * float(gl_VertexID & 1) - 1.0, 4.0 * float(gl_VertexID >> 1) - 1.0, 1.0, 1.0);
}`;

/** The frame's own pixels; \`u_corner\` is the pixel at the target's top left. */
export const COPY = `${HEAD}
uniform sampler2D u_frame;
uniform ivec2 u_corner;
uniform int u_height;
out vec4 color;
void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  color = vec4(texelFetch(u_frame, u_corner + ivec2(at.x, u_height - 1 - at.y), 0).rgb, 1.0);
}`;

/**
 * A grid over the frame, one strip of triangles per instance: vertices at the centres of its cells and along the edge.
 * Without depth, everything is on a sphere around the frame's camera. There is no division by depth, so infinity needs
 * no special case.
 */
export const MESH_VERTEX = `${HEAD}
uniform mat3 u_turn; // from the frame's (u, v, 1), 0 to 1, to clip space's x, y, w
uniform vec3 u_shift; // of a point at inverse depth 1
uniform vec2 u_cells; // of the grid
uniform bool u_has_depth;
uniform sampler2D u_depth;
uniform float u_nearest; // inverse depth of code 255, or of the sphere's radius
uniform mat3 u_ray; // from (u, v, 1) to the camera's direction with z = 1
uniform float u_limit; // the largest inverse depth that is drawn
out vec2 v_at;
void main() {
  vec2 vertex = vec2(gl_VertexID >> 1, gl_InstanceID + (gl_VertexID & 1));
  v_at = clamp((vertex - 0.5) / u_cells, 0.0, 1.0);
  vec3 at = vec3(v_at, 1.0);
  float inverse_depth = u_nearest * (u_has_depth ? texture(u_depth, v_at).r : length(u_ray * at));
  vec3 clip = u_turn * at + inverse_depth * u_shift;
  // Divided by w, z falls with inverse depth in the view, from just before the far end to the near one.
  gl_Position = vec4(clip.xy, 0.999 * clip.z - 1.999 * inverse_depth / u_limit, clip.z);
}`;

/**
 * Catmull-Rom for magnification (nine bilinear taps), the mean of four bilinear taps for minification; or one tap, for
 * speed.
 */
const SAMPLE = `
vec3 tap(vec2 at) {
  return textureLod(u_frame, at, 0.0).rgb;
}
vec3 mean(vec2 at, vec2 quarter) {
  return 0.25 * (tap(at + quarter) + tap(at - quarter)
    + tap(at + vec2(quarter.x, -quarter.y)) + tap(at + vec2(-quarter.x, quarter.y)));
}
vec3 sharp(vec2 at) {
  vec2 size = vec2(textureSize(u_frame, 0));
  vec2 center = floor(at * size - 0.5) + 0.5;
  vec2 f = at * size - center;
  vec2 w0 = f * (-0.5 + f * (1.0 - 0.5 * f));
  vec2 w1 = 1.0 + f * f * (1.5 * f - 2.5);
  vec2 w2 = f * (0.5 + f * (2.0 - 1.5 * f));
  vec2 w3 = f * f * (0.5 * f - 0.5);
  vec2 w12 = w1 + w2;
  vec2 a = (center - 1.0) / size;
  vec2 b = (center + w2 / w12) / size;
  vec2 c = (center + 2.0) / size;
  return w0.y * (w0.x * tap(a) + w12.x * tap(vec2(b.x, a.y)) + w3.x * tap(vec2(c.x, a.y)))
    + w12.y * (w0.x * tap(vec2(a.x, b.y)) + w12.x * tap(b) + w3.x * tap(vec2(c.x, b.y)))
    + w3.y * (w0.x * tap(vec2(a.x, c.y)) + w12.x * tap(vec2(b.x, c.y)) + w3.x * tap(c));
}`;

export const MESH_FRAGMENT = `${HEAD}
uniform sampler2D u_frame;
uniform float u_step; // from one pixel of the target to the next, in the frame's
uniform bool u_quick;
in vec2 v_at;
out vec4 color;
${SAMPLE}
void main() {
  vec3 picture = u_quick ? tap(v_at)
    : u_step > 1.25 ? mean(v_at, 0.25 * u_step / vec2(textureSize(u_frame, 0))) : sharp(v_at);
  color = vec4(picture, 1.0);
}`;

/** The frame as one side of a cube around the camera sees it. */
export const KEEP = `${HEAD}
uniform sampler2D u_frame;
uniform mat3 u_to_frame; // from the side's (x, y, 1) in pixels to the frame's (u, v, 1), homogeneous
uniform float u_step;
out vec4 color;
${SAMPLE}
void main() {
  vec3 at = u_to_frame * vec3(gl_FragCoord.xy, 1.0);
  vec2 uv = at.xy / at.z;
  if (at.z <= 0.0 || any(lessThan(uv, vec2(0.0))) || any(greaterThan(uv, vec2(1.0)))) discard;
  color = vec4(mean(uv, 0.25 * u_step / vec2(textureSize(u_frame, 0))), 1.0);
}`;

/** The cube's contents outside the mesh. */
export const FILL = `${HEAD}
uniform samplerCube u_cube;
uniform mat3 u_direction; // from the target's (x, y, 1) in pixels
out vec4 color;
void main() {
  vec4 seen = texture(u_cube, u_direction * vec3(gl_FragCoord.xy, 1.0));
  if (seen.a < 0.5) discard;
  color = vec4(seen.rgb / seen.a, 1.0);
}`;

/** A side of the surround, on a sphere of radius 1 around the position from which it was rendered. */
export const SIDE = `${HEAD}
uniform sampler2D u_side;
uniform mat3 u_direction; // from the target's (x, y, 1) in pixels
uniform vec3 u_offset; // from the side's place to the view's
uniform mat3 u_to_side; // from a direction to the side's (u, v, 1), homogeneous
out vec4 color;
void main() {
  vec3 ray = normalize(u_direction * vec3(gl_FragCoord.xy, 1.0));
  float along = dot(ray, u_offset);
  float reach = sqrt(along * along + 1.0 - dot(u_offset, u_offset)) - along;
  vec3 at = u_to_side * (u_offset + reach * ray);
  vec2 uv = at.xy / at.z;
  if (at.z <= 0.0 || any(lessThan(uv, vec2(0.0))) || any(greaterThan(uv, vec2(1.0)))) discard;
  color = vec4(textureLod(u_side, uv, 0.0).rgb, 1.0);
}`;
