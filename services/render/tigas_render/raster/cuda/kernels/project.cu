// Projects Gaussians to records of the visible ones, and counts the entries of each tile's list.
// [3DGS] Kerbl et al. 2023: spherical harmonics. [EWA] Zwicker et al. 2002: the projected covariance.
// [gsplat] Ye et al. 2024: clamping of the derivative. Filters: `footprint` in raster/base.py.
// reference/rasterizer.py is a slow reference of the same algorithm.
#include "frame.cuh"
#include "tiles.cuh"

struct Colour {
    float r, g, b;
};

// The colour seen along the unit direction (x, y, z). Coefficients are already multiplied by the constants of their
// basis functions [3DGS]; they are coefficient-major, then red, green, blue, with four per group.
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
    // Degrees end in groups 1, 3, 7 and 12. The loads of each degree are issued together before the first is used.
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

// EWA projection of Gaussian i. Returns false if it cannot be drawn.
template <int TILE>
__device__ bool project_one(const Frame& f, u32 i, float4& s0, float4& s1, ushort4& box, float& depth) {
    float wx = f.means[i] - f.eye[0], wy = f.means[f.padded + i] - f.eye[1], wz = f.means[2 * f.padded + i] - f.eye[2];
    const float* R = f.rotation;
    float z = R[6] * wx + R[7] * wy + R[8] * wz;
    if (!(z >= NEAR_PLANE && z < 1e30f)) return false;
    float x = R[0] * wx + R[1] * wy + R[2] * wz, y = R[3] * wx + R[4] * wy + R[5] * wz;
    uint4 shape = f.shapes[i];
    float log_alpha = log2f((shape.y >> 16) * (1.f / 65535));
    if (!(log_alpha >= LOG2_ALPHA_MIN)) return false;
    float scale0 = exp2f(f.scale_low + f.scale_step * (shape.x & 0xffff));
    float scale1 = exp2f(f.scale_low + f.scale_step * (shape.x >> 16));
    float scale2 = exp2f(f.scale_low + f.scale_step * (shape.y & 0xffff));
    float qw = (short)shape.z, qx = (short)(shape.z >> 16), qy = (short)shape.w, qz = (short)(shape.w >> 16);
    float q = 2 / (qw * qw + qx * qx + qy * qy + qz * qz);  // for quaternions of any length

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
    // the rows p and q of J W R S; its product with its transpose is the projected covariance
    float p0 = scale0 * (ax * x0 + ay * y0 + az * z0), p1 = scale1 * (ax * x1 + ay * y1 + az * z1);
    float p2 = scale2 * (ax * x2 + ay * y2 + az * z2);
    float q0 = scale0 * (bx * x0 + by * y0 + bz * z0), q1 = scale1 * (bx * x1 + by * y1 + bz * z1);
    float q2 = scale2 * (bx * x2 + by * y2 + bz * z2);
    float cxx = p0 * p0 + p1 * p1 + p2 * p2, cyy = q0 * q0 + q1 * q1 + q2 * q2;
    float cxy = p0 * q0 + p1 * q1 + p2 * q2;
    // opacity lost to the filter: det(Σ + c I) = det Σ + c tr Σ + c², safe where det Σ is nearly 0
    float area = fmaxf(cxx * cyy - cxy * cxy, 0.f), trace = cxx + cyy;
    log_alpha += 0.5f * log2f((area + f.dilation * (trace + f.dilation)) / (area + f.filtered * (trace + f.filtered)));
    if (!(log_alpha >= LOG2_ALPHA_MIN)) return false;
    cxx += f.filtered, cyy += f.filtered;
    float determinant = cxx * cyy - cxy * cxy;
    float scale = 0.5f * LOG2_E / determinant;
    float reach = (log_alpha - LOG2_ALPHA_MIN) * (2 / LOG2_E);  // squared, in deviations
    float rx = sqrtf(reach * cxx), ry = sqrtf(reach * cyy);
    // false for NaN, and for values that would overflow later
    if (!(determinant > 0 && scale * (cxx + cyy) < 1e6f && fabsf(u) < FARTHEST && fabsf(v) < FARTHEST &&
          rx < 1e30f && ry < 1e30f))
        return false;
    // pixels with centres within reach
    int left = (int)(clamp(u - rx, 0.f, f.width) + 0.5f), right = (int)(clamp(u + rx, 0.f, f.width) + 0.5f);
    int top = (int)(clamp(v - ry, 0.f, f.height) + 0.5f), bottom = (int)(clamp(v + ry, 0.f, f.height) + 0.5f);
    if (left >= right || top >= bottom) return false;
    int tx0 = left / TILE, ty0 = top / TILE;
    box = make_ushort4(tx0, ty0, (right - 1) / TILE - tx0 + 1, (bottom - 1) / TILE - ty0 + 1);
    float length = rsqrtf(wx * wx + wy * wy + wz * wz);
    Colour colour = f.format == DEPTH ? Colour{inverse, 1, 0} : shade(f, i, wx * length, wy * length, wz * length);
    u32 red_green = to_half(fminf(colour.r, 6e4f)) | to_half(fminf(colour.g, 6e4f)) << 16;
    u32 blue = to_half(fminf(colour.b, 6e4f));
    s0 = make_float4(u, v, scale * cyy, -2 * scale * cxy);
    s1 = make_float4(scale * cxx, log_alpha, __uint_as_float(red_green), __uint_as_float(blue));
    depth = z;
    return true;
}

// The chosen chunk with index `at`, which is in the last range with at most `at` chosen chunks before it.
__device__ __forceinline__ u32 chosen_chunk(const Frame& f, const u32* before, u32 ranges, u32 range, u32 at) {
    u32 low = 0, high = ranges;
    while (high - low > 1) {
        u32 middle = (low + high) / 2;
        if (before[middle] <= at) low = middle;
        else high = middle;
    }
    return f.chosen[low * range + at - before[low]];
}

// Counts an entry of a list, with a single addition for lanes with the same list.
__device__ __forceinline__ void count_entry(const Frame& f, bool hit, u32 list) {
    u32 peers = __match_any_sync(ALL, hit ? list : ALL);
    if (hit && __ffs(peers) - 1 == (threadIdx.x & 31)) atomicAdd(&f.counts[list], __popc(peers));
}

template <int TILE>
__device__ __forceinline__ void project_all(const Frame* frame) {
    __shared__ Frame f;
    __shared__ Staged staged[CHUNK];
    __shared__ u32 before[MAX_RANGES], chunks[CHUNK];
    for (int word = threadIdx.x; word < FRAME_WORDS; word += CHUNK) ((u32*)&f)[word] = ((const u32*)frame)[word];
    __syncthreads();
    u32 chosen = min(f.progress->chosen, f.room), range = f.progress->range, ranges = f.progress->ranges;
    for (u32 k = threadIdx.x; k < ranges; k += CHUNK) before[k] = f.progress->before[k];
    for (u32 at = blockIdx.x, turn = 0; at < chosen; at += gridDim.x, turn++) {
        if (turn % CHUNK == 0) {  // look up the chunks of the next turns in parallel
            __syncthreads();
            u32 its = at + threadIdx.x * gridDim.x;
            if (its < chosen) chunks[threadIdx.x] = chosen_chunk(f, before, ranges, range, its);
            __syncthreads();
        }
        u32 i = chunks[turn % CHUNK] * CHUNK + threadIdx.x, slot = at * CHUNK + threadIdx.x;
        float4 s0, s1;
        float depth;
        ushort4 box;
        if (project_one<TILE>(f, i, s0, s1, box, depth)) {
            f.splats[2 * slot] = s0, f.splats[2 * slot + 1] = s1;
            f.depths[slot] = depth;
            if (is_large(box)) f.large[atomicAdd(&f.progress->large, 1)] = slot;
        } else {
            box = make_ushort4(0, 0, 0, 0);
        }
        f.boxes[slot] = box;
        for_each_tile<TILE>(f, s0, s1, box, depth, staged + (threadIdx.x & ~31),
                            [&](bool hit, u32 list, u32, float) { count_entry(f, hit, list); });
    }
}

// Counts the entries of the large Gaussians, once all are known.
template <int TILE>
__device__ __forceinline__ void count_large(const Frame* frame) {
    __shared__ Frame f;
    for (int word = threadIdx.x; word < FRAME_WORDS; word += CHUNK) ((u32*)&f)[word] = ((const u32*)frame)[word];
    __syncthreads();
    // a Gaussian is in a list only once, so its lanes never share a list
    for_each_large<TILE>(f, [&](bool hit, u32 list, u32, float) {
        if (hit) atomicAdd(&f.counts[list], 1);
    });
}

extern "C" __global__ void __launch_bounds__(CHUNK) project_16(const Frame* frame) { project_all<16>(frame); }
extern "C" __global__ void __launch_bounds__(CHUNK) project_8(const Frame* frame) { project_all<8>(frame); }
extern "C" __global__ void __launch_bounds__(CHUNK) large_16(const Frame* frame) { count_large<16>(frame); }
extern "C" __global__ void __launch_bounds__(CHUNK) large_8(const Frame* frame) { count_large<8>(frame); }
