// From Gaussians in space to records of those that are visible, and how many entries each tile's list will have.
// [3DGS] Kerbl et al. 2023: spherical harmonics. [EWA] Zwicker et al. 2002: the projected covariance.
// [gsplat] Ye et al. 2024: clamping of the derivative. Twin: raster/reference.py.
#include "frame.cuh"
#include "tiles.cuh"

// Whether no Gaussian of a chunk can be drawn; false when in doubt. A chunk is a sphere around its means and the
// greatest deviation among its Gaussians. The least depth bounds how large those deviations become in pixels.
__device__ bool chunk_is_outside(const Frame& f, u32 chunk) {
    float4 sphere = f.bounds[2 * chunk];
    float deviation = f.bounds[2 * chunk + 1].x;
    float x = sphere.x - f.eye[0], y = sphere.y - f.eye[1], z = sphere.z - f.eye[2], r = sphere.w;
    float px = f.rotation[0] * x + f.rotation[1] * y + f.rotation[2] * z;
    float py = f.rotation[3] * x + f.rotation[4] * y + f.rotation[5] * z;
    float pz = f.rotation[6] * x + f.rotation[7] * y + f.rotation[8] * z;
    if (pz + r < 0.999f * NEAR_PLANE) return true;
    float nearest = pz - r;
    if (!(nearest > NEAR_PLANE)) return false;
    constexpr float REACH = 3.37f;  // sqrt(2 ln 255), and a little
    float slope_x = fmaxf(fabsf(f.left), fabsf(f.right)), slope_y = fmaxf(fabsf(f.top), fabsf(f.bottom));
    float sx = f.fx * deviation / nearest, sy = f.fy * deviation / nearest;
    float margin_x = (REACH * sqrtf(sx * sx * (1 + slope_x * slope_x) + BLUR) + 2) / f.fx;
    float margin_y = (REACH * sqrtf(sy * sy * (1 + slope_y * slope_y) + BLUR) + 2) / f.fy;
    // planes through the eye: outside where the signed distance of the sphere's centre is more than its radius
    float l = -f.cx / f.fx - margin_x, rr = (f.width - f.cx) / f.fx + margin_x;
    float t = -f.cy / f.fy - margin_y, b = (f.height - f.cy) / f.fy + margin_y;
    return l * pz - px > r * sqrtf(1 + l * l) || px - rr * pz > r * sqrtf(1 + rr * rr) ||
           t * pz - py > r * sqrtf(1 + t * t) || py - b * pz > r * sqrtf(1 + b * b);
}

struct Colour {
    float r, g, b;
};

// The colour seen along the unit direction (x, y, z). Coefficients come times the constants of their basis functions
// [3DGS], in the order coefficient-major, red, green, blue; four a group.
__device__ __forceinline__ Colour shade(const Frame& f, u32 i, float x, float y, float z) {
    float basis[16];
    float xx = x * x, yy = y * y, zz = z * z;
    basis[0] = 1, basis[1] = y, basis[2] = z, basis[3] = x;
    basis[4] = x * y, basis[5] = y * z, basis[6] = 2 * zz - xx - yy, basis[7] = x * z, basis[8] = xx - yy;
    basis[9] = y * (3 * xx - yy), basis[10] = x * y * z, basis[11] = y * (4 * zz - xx - yy);
    basis[12] = z * (2 * zz - 3 * xx - 3 * yy), basis[13] = x * (4 * zz - xx - yy), basis[14] = z * (xx - yy);
    basis[15] = x * (xx - 3 * yy);
    float colour[3] = {0.5f, 0.5f, 0.5f};
    int numbers = 3 * f.sh_coefficients;
    // Degrees end in groups 1, 3, 7 and 12: each batch of loads is issued together before the first is used.
#define GROUPS(FROM, TO)                                                                     \
    if (numbers > 4 * FROM) {                                                                \
        uint2 group[TO - FROM];                                                              \
        _Pragma("unroll") for (int g = 0; g < TO - FROM; g++)                                \
            group[g] = __ldg(&f.sh[(u64)(FROM + g) * f.padded + i]);                        \
        _Pragma("unroll") for (int n = 0; n < 4 * (TO - FROM); n++) {                        \
            constexpr int FIRST = 4 * FROM;                                                  \
            u32 word = n & 2 ? group[n / 4].y : group[n / 4].x;                              \
            if ((FIRST + n) / 3 < 16)                                                        \
                colour[(FIRST + n) % 3] += basis[((FIRST + n) / 3) & 15] * from_half(n & 1 ? word >> 16 : word); \
        }                                                                                    \
    }
    GROUPS(0, 1)
    GROUPS(1, 3)
    GROUPS(3, 7)
    GROUPS(7, 12)
#undef GROUPS
    return {fmaxf(colour[0], 0.f), fmaxf(colour[1], 0.f), fmaxf(colour[2], 0.f)};
}

// EWA projection of Gaussian i. False if it cannot be drawn; then nothing is written.
template <int TILE>
__device__ bool project_one(const Frame& f, u32 i, Splat& splat, ushort4& box) {
    float wx = f.means[i] - f.eye[0], wy = f.means[f.padded + i] - f.eye[1], wz = f.means[2 * f.padded + i] - f.eye[2];
    const float* R = f.rotation;
    float z = R[6] * wx + R[7] * wy + R[8] * wz;
    if (!(z >= NEAR_PLANE && z < 1e30f)) return false;
    float x = R[0] * wx + R[1] * wy + R[2] * wz, y = R[3] * wx + R[4] * wy + R[5] * wz;
    uint4 shape = f.shapes[i];
    float log_alpha = log2f((shape.y >> 16) * (1.f / 65535));
    if (!(log_alpha >= LOG2_ALPHA_MIN)) return false;
    float s0 = exp2f(f.scale_low + f.scale_step * (shape.x & 0xffff));
    float s1 = exp2f(f.scale_low + f.scale_step * (shape.x >> 16));
    float s2 = exp2f(f.scale_low + f.scale_step * (shape.y & 0xffff));
    float qw = (short)shape.z, qx = (short)(shape.z >> 16), qy = (short)shape.w, qz = (short)(shape.w >> 16);
    float q = 2 / (qw * qw + qx * qx + qy * qy + qz * qz);  // any length will do

    float inverse = 1 / z;
    float tx = x * inverse, ty = y * inverse;
    float u = f.fx * tx + f.cx, v = f.fy * ty + f.cy;
    tx = clamp(tx, f.left, f.right), ty = clamp(ty, f.top, f.bottom);
    // rows of J W, the derivative of the projection in world axes [EWA]
    float jx = f.fx * inverse, jy = f.fy * inverse;
    float ax = jx * (R[0] - tx * R[6]), ay = jx * (R[1] - tx * R[7]), az = jx * (R[2] - tx * R[8]);
    float bx = jy * (R[3] - ty * R[6]), by = jy * (R[4] - ty * R[7]), bz = jy * (R[5] - ty * R[8]);
    // columns of the Gaussian's rotation
    float x0 = 1 - q * (qy * qy + qz * qz), x1 = q * (qx * qy - qw * qz), x2 = q * (qx * qz + qw * qy);
    float y0 = q * (qx * qy + qw * qz), y1 = 1 - q * (qx * qx + qz * qz), y2 = q * (qy * qz - qw * qx);
    float z0 = q * (qx * qz - qw * qy), z1 = q * (qy * qz + qw * qx), z2 = 1 - q * (qx * qx + qy * qy);
    // half of J W R S: its product with its own transpose is the projected covariance
    float p0 = s0 * (ax * x0 + ay * y0 + az * z0), p1 = s1 * (ax * x1 + ay * y1 + az * z1);
    float p2 = s2 * (ax * x2 + ay * y2 + az * z2);
    float q0 = s0 * (bx * x0 + by * y0 + bz * z0), q1 = s1 * (bx * x1 + by * y1 + bz * z1);
    float q2 = s2 * (bx * x2 + by * y2 + bz * z2);
    float cxx = p0 * p0 + p1 * p1 + p2 * p2 + BLUR, cyy = q0 * q0 + q1 * q1 + q2 * q2 + BLUR;
    float cxy = p0 * q0 + p1 * q1 + p2 * q2;
    float determinant = cxx * cyy - cxy * cxy;
    float scale = 0.5f * LOG2_E / determinant;
    float reach = (log_alpha - LOG2_ALPHA_MIN) * (2 / LOG2_E);  // squared, in deviations
    float rx = sqrtf(reach * cxx), ry = sqrtf(reach * cyy);
    // false for NaN, and for what would overflow later on
    if (!(determinant > 0 && scale * (cxx + cyy) < 1e6f && fabsf(u) < FARTHEST && fabsf(v) < FARTHEST &&
          rx < 1e30f && ry < 1e30f))
        return false;
    // pixels whose centres lie within reach
    int left = (int)(clamp(u - rx, 0.f, f.width) + 0.5f), right = (int)(clamp(u + rx, 0.f, f.width) + 0.5f);
    int top = (int)(clamp(v - ry, 0.f, f.height) + 0.5f), bottom = (int)(clamp(v + ry, 0.f, f.height) + 0.5f);
    if (left >= right || top >= bottom) return false;
    int tx0 = left / TILE, ty0 = top / TILE;
    box = make_ushort4(tx0, ty0, (right - 1) / TILE - tx0 + 1, (bottom - 1) / TILE - ty0 + 1);
    splat = {u, v, scale * cyy, -2 * scale * cxy, scale * cxx, log_alpha};
    float length = rsqrtf(wx * wx + wy * wy + wz * wz);
    Colour colour = shade(f, i, wx * length, wy * length, wz * length);
    u32 red_green = to_half(fminf(colour.r, 6e4f)) | to_half(fminf(colour.g, 6e4f)) << 16;
    u32 blue = to_half(fminf(colour.b, 6e4f));
    f.splats[2 * i] = make_float4(u, v, splat.a, splat.b);
    f.splats[2 * i + 1] = make_float4(splat.c, log_alpha, __uint_as_float(red_green), __uint_as_float(blue));
    f.depths[i] = z;
    return true;
}

// Where each tile's list begins: one block's exclusive scan of the counts. Writes the total to the host's status.
__device__ void place_lists(const Frame& f) {
    __shared__ u32 sums[CHUNK / 32];
    u32 total = 0;
    int lane = threadIdx.x & 31, warp = threadIdx.x / 32;
    for (u32 first = 0; first < f.tiles; first += CHUNK * 4) {
        u32 at = first + threadIdx.x * 4, counts[4], mine = 0;
        for (int k = 0; k < 4; k++) {
            counts[k] = at + k < f.tiles ? __ldcg(&f.tile_counts[at + k]) : 0;
            mine += counts[k];
        }
        u32 last = mine;
        for (int step = 1; step < 32; step *= 2) {
            u32 other = __shfl_up_sync(ALL, last, step);
            if (lane >= step) last += other;
        }
        if (lane == 31) sums[warp] = last;
        __syncthreads();
        u32 start = total + last - mine;
        for (int w = 0; w < CHUNK / 32; w++) {
            if (w < warp) start += sums[w];
            total += sums[w];
        }
        for (int k = 0; k < 4; k++) {
            if (at + k < f.tiles) f.tile_starts[at + k] = f.tile_ends[at + k] = start;
            start += counts[k];
        }
        __syncthreads();
    }
    if (threadIdx.x == 0) {
        f.status[0] = total;
        __threadfence_system();
    }
}

template <int TILE>
__device__ __forceinline__ void project_all(const Frame* frame) {
    __shared__ Frame f;
    __shared__ float4 staged[CHUNK * 3];
    __shared__ bool last_block;
    for (int word = threadIdx.x; word < FRAME_WORDS; word += CHUNK) ((u32*)&f)[word] = ((const u32*)frame)[word];
    __syncthreads();
    for (u32 chunk = blockIdx.x; chunk < f.chunks; chunk += gridDim.x) {
        bool visible = false;
        Splat splat = {};
        ushort4 box = make_ushort4(0, 0, 0, 0);
        u32 i = chunk * CHUNK + threadIdx.x;
        bool outside = chunk_is_outside(f, chunk);
        if (!outside) {
            visible = project_one<TILE>(f, i, splat, box);
            f.boxes[i] = box;
            for_each_tile<TILE>(f, splat, box, staged + (threadIdx.x / 32) * 96, [&](bool hit, u32 tile, int) {
                if (hit) atomicAdd(&f.tile_counts[tile], 1);
            });
        }
        visible = __syncthreads_or(visible);
        if (threadIdx.x == 0) f.chunk_visible[chunk] = visible;
    }
    // The block that finishes last places the lists: no further kernel, no waiting.
    __threadfence();
    __syncthreads();
    if (threadIdx.x == 0) last_block = atomicAdd(&f.progress[0], 1) == gridDim.x - 1;
    __syncthreads();
    if (last_block) {
        __threadfence();
        place_lists(f);
    }
}

extern "C" __global__ void __launch_bounds__(CHUNK) project_16(const Frame* frame) { project_all<16>(frame); }
extern "C" __global__ void __launch_bounds__(CHUNK) project_8(const Frame* frame) { project_all<8>(frame); }
