// The frame's first kernel: stores the parameters for the others, clears the counts and the image, chooses the chunks
// that may be visible, at the level of detail that the image can show, and divides depth into slices with about equal
// numbers of Gaussians, so that no list becomes long.
#include "frame.cuh"
#include "pixels.cuh"

constexpr u32 NO_PARENT = 0xffffffffu;

// Whether a chunk's cells have short edges at its nearest point; always true for the full detail.
__device__ __forceinline__ bool is_fine(const Frame& f, float edge, float nearest) {
    return edge <= f.reach * fmaxf(nearest, 0.f);
}

__device__ bool parent_is_fine(const Frame& f, u32 parent) {
    if (parent == NO_PARENT || f.reach == 0) return false;
    float4 sphere = f.bounds[2 * parent];
    float x = sphere.x - f.eye[0], y = sphere.y - f.eye[1], z = sphere.z - f.eye[2];
    float pz = f.rotation[6] * x + f.rotation[7] * y + f.rotation[8] * z;
    return is_fine(f, f.bounds[2 * parent + 1].y, pz - sphere.w);
}

// Whether no Gaussian of a chunk has to be drawn; false if in doubt. A chunk is bounded by a sphere around its means
// and the largest deviation of its Gaussians. The smallest depth limits how large this deviation becomes in pixels.
// A chunk is also skipped if it is not fine enough, or if its parent is: see levels.py.
__device__ bool is_left_out(const Frame& f, u32 chunk, float& depth) {
    float4 sphere = f.bounds[2 * chunk], detail = f.bounds[2 * chunk + 1];
    float deviation = detail.x;
    float x = sphere.x - f.eye[0], y = sphere.y - f.eye[1], z = sphere.z - f.eye[2], r = sphere.w;
    float px = f.rotation[0] * x + f.rotation[1] * y + f.rotation[2] * z;
    float py = f.rotation[3] * x + f.rotation[4] * y + f.rotation[5] * z;
    float pz = f.rotation[6] * x + f.rotation[7] * y + f.rotation[8] * z;
    depth = pz;
    float nearest = pz - r;
    if (pz + r < 0.999f * NEAR_PLANE || !is_fine(f, detail.y, nearest) || parent_is_fine(f, __float_as_uint(detail.z)))
        return true;
    if (!(nearest > NEAR_PLANE)) return false;
    constexpr float REACH = 3.37f;  // sqrt(2 ln 255), with a margin
    float slope_x = fmaxf(fabsf(f.left), fabsf(f.right)), slope_y = fmaxf(fabsf(f.top), fabsf(f.bottom));
    float sx = f.fx * deviation / nearest, sy = f.fy * deviation / nearest;
    float margin_x = (REACH * sqrtf(sx * sx * (1 + slope_x * slope_x) + f.filtered) + 2) / f.fx;
    float margin_y = (REACH * sqrtf(sy * sy * (1 + slope_y * slope_y) + f.filtered) + 2) / f.fy;
    // planes through the eye: the sphere is outside if its centre's signed distance exceeds its radius
    float l = -f.cx / f.fx - margin_x, rr = (f.width - f.cx) / f.fx + margin_x;
    float t = -f.cy / f.fy - margin_y, b = (f.height - f.cy) / f.fy + margin_y;
    return l * pz - px > r * sqrtf(1 + l * l) || px - rr * pz > r * sqrtf(1 + rr * rr) ||
           t * pz - py > r * sqrtf(1 + t * t) || py - b * pz > r * sqrtf(1 + b * b);
}

// The sum of the values of all earlier threads in a block of CHUNK threads, which must all call it, and the `total`.
template <class Number>
__device__ __forceinline__ Number exclusive_scan(Number value, Number* warps, Number& total) {
    int lane = threadIdx.x & 31, warp = threadIdx.x / 32;
    Number last = value;
    for (int step = 1; step < 32; step *= 2) {
        Number other = __shfl_up_sync(ALL, last, step);
        if (lane >= step) last += other;
    }
    __syncthreads();  // for an earlier scan
    if (lane == 31) warps[warp] = last;
    __syncthreads();
    Number before = last - value;
    total = 0;
    for (int w = 0; w < CHUNK / 32; w++) {
        if (w < warp) before += warps[w];
        total += warps[w];
    }
    return before;
}

// Called by one block: turns the number of chosen chunks in each range into the number before each range, and divides
// the depth bins into slices with equal shares of the chosen chunks. One scan computes both sums, in the halves of a
// word. Returns the number of all chosen chunks.
__device__ u32 add_up(const Frame& f, u64* warps) {
    constexpr int BINS = DEPTH_BINS / CHUNK, RANGES = MAX_RANGES / CHUNK;
    u32 counts[BINS], in_bins = 0, of_ranges[RANGES], in_ranges = 0;
#pragma unroll
    for (int k = 0; k < BINS; k += 4) {
        uint4 four = __ldcg((uint4*)&f.progress->depths[threadIdx.x * BINS + k]);
        counts[k] = four.x, counts[k + 1] = four.y, counts[k + 2] = four.z, counts[k + 3] = four.w;
        in_bins += four.x + four.y + four.z + four.w;
        *(uint4*)&f.progress->depths[threadIdx.x * BINS + k] = make_uint4(0, 0, 0, 0);
    }
#pragma unroll
    for (int k = 0; k < RANGES; k++) {
        u32 range = threadIdx.x * RANGES + k;
        in_ranges += of_ranges[k] = range < gridDim.x ? __ldcg(&f.progress->before[range]) : 0;
    }
    u64 all, both = exclusive_scan((u64)in_ranges << 32 | in_bins, warps, all);
    u32 before = (u32)both, total = (u32)all;
    float share = (float)f.slices / max(total, 1u);
#pragma unroll
    for (int k = 0; k < BINS; k += 4) {
        u32 four = 0;
#pragma unroll
        for (int j = 0; j < 4; j++) {
            four |= min((u32)((before + 0.5f * counts[k + j]) * share), f.slices - 1) << 8 * j;
            before += counts[k + j];
        }
        ((u32*)f.slice_of)[(threadIdx.x * BINS + k) / 4] = four;
    }
    before = (u32)(both >> 32);
#pragma unroll
    for (int k = 0; k < RANGES; k++) {
        f.progress->before[threadIdx.x * RANGES + k] = before;
        before += of_ranges[k];
    }
    return total;
}

// Launched with at most MAX_RANGES blocks of CHUNK threads. `f` is a launch argument; other kernels read it at `frame`.
extern "C" __global__ void __launch_bounds__(CHUNK) begin(const __grid_constant__ Frame f, Frame* frame) {
    __shared__ u64 sums[CHUNK / 32];
    __shared__ bool last_block;
    if (blockIdx.x == 0)
        for (int word = threadIdx.x; word < FRAME_WORDS; word += CHUNK) ((u32*)frame)[word] = ((const u32*)&f)[word];
    u32 thread = blockIdx.x * CHUNK + threadIdx.x, threads = gridDim.x * CHUNK;
    for (u32 at = thread; at < f.tiles * f.slices / 4; at += threads) ((uint4*)f.counts)[at] = make_uint4(0, 0, 0, 0);
    fill(f, thread, threads);
    u32 chunks = f.padded / CHUNK;
    u32 range = (chunks + gridDim.x - 1) / gridDim.x, from = blockIdx.x * range, count = 0;
    u32 end = min(from + range, chunks);
    for (u32 first = from; first < end; first += CHUNK) {
        u32 chunk = first + threadIdx.x;
        float depth = 0;
        bool chosen = chunk < end && !is_left_out(f, chunk, depth);
        u32 all, rank = exclusive_scan((u32)chosen, (u32*)sums, all);
        if (chosen) {
            f.chosen[from + count + rank] = chunk;
            atomicAdd(&f.progress->depths[depth_bin(depth)], 1);
        }
        count += all;
    }
    if (threadIdx.x == 0) f.progress->before[blockIdx.x] = count;
    // The last block to finish adds up and divides the slices, which needs no further kernel and no waiting.
    __threadfence();
    __syncthreads();
    if (threadIdx.x == 0) last_block = atomicAdd(&f.progress->culled, 1) == gridDim.x - 1;
    __syncthreads();
    if (!last_block) return;
    __threadfence();
    u32 chosen = add_up(f, sums);
    if (threadIdx.x == 0) {
        f.progress->chosen = chosen;
        f.progress->range = range, f.progress->ranges = gridDim.x;
        f.progress->culled = f.progress->entries = f.progress->partials = 0;
        f.progress->segment = min(max(chosen * CHUNK / MIN_SEGMENT, MIN_SEGMENT), MAX_SEGMENT);
    }
}
