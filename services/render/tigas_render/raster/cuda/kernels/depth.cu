// Encodes a frame's depth as 8-bit codes and the inverse depth of code 255, like encode/depth_segment.py on the host.
#include "frame.cuh"

constexpr int DEPTH_THREADS = 1024;
constexpr int DIGIT = 11, DIGITS = 1 << DIGIT;  // of a radix selection, in a float's bits
constexpr float OPACITY_MIN = 0.1f;             // as in raster/base.py
constexpr u32 CLIPPED = 200;                    // one pixel in 200 may be nearer than code 255, as in depth_segment.py

// The bits of the inverse depth, which have the same order as the values, because these are not negative.
__device__ __forceinline__ u32 inverse_depth(float2 means) {
    return means.y >= OPACITY_MIN ? __float_as_uint(__fdividef(means.x, means.y)) : 0;
}

// The upper 22 bits of the `rank`-th smallest inverse depth. All threads of the block must call it.
__device__ u32 radix_select(const float2* means, u32 count, u32 rank) {
    __shared__ u32 bins[DIGITS], warps[DEPTH_THREADS / 32], digit, rest;
    int lane = threadIdx.x & 31, warp = threadIdx.x / 32;
    u32 prefix = 0;
    for (int shift = 32 - DIGIT; shift >= 32 - 2 * DIGIT; shift -= DIGIT) {
        for (u32 at = threadIdx.x; at < DIGITS; at += DEPTH_THREADS) bins[at] = 0;
        __syncthreads();
        for (u32 at = threadIdx.x; at < count; at += DEPTH_THREADS) {
            u32 bits = inverse_depth(means[at]);
            bool is_in = shift == 32 - DIGIT || bits >> (shift + DIGIT) == prefix;
            if (is_in) atomicAdd(&bins[bits >> shift & (DIGITS - 1)], 1);
        }
        __syncthreads();
        u32 first = bins[2 * threadIdx.x], both = first + bins[2 * threadIdx.x + 1], last = both;
        for (int step = 1; step < 32; step *= 2) {
            u32 other = __shfl_up_sync(ALL, last, step);
            if (lane >= step) last += other;
        }
        if (lane == 31) warps[warp] = last;
        __syncthreads();
        u32 before = last - both;
        for (int w = 0; w < warp; w++) before += warps[w];
        if (before <= rank && rank < before + both) {
            bool is_second = rank >= before + first;
            digit = 2 * threadIdx.x + is_second;
            rest = rank - before - (is_second ? first : 0);
        }
        __syncthreads();
        prefix = prefix << DIGIT | digit;
        rank = rest;
    }
    return prefix;
}

// Launched with one block after blending. Writes the codes after the means, and the inverse depth of code 255 to
// status[2].
extern "C" __global__ void __launch_bounds__(DEPTH_THREADS) code_depth(const Frame* frame) {
    __shared__ u32 greatest;
    const Frame& f = *frame;
    const float2* means = (const float2*)f.pixels;
    u32 count = f.width * f.height, mine = 0;
    if (threadIdx.x == 0) greatest = 0;
    u32 bits = radix_select(means, count, count - 1 - (count - 1) / CLIPPED) << (32 - 2 * DIGIT);
    if (bits == 0) {  // almost all pixels are empty, so none is clipped
        for (u32 at = threadIdx.x; at < count; at += DEPTH_THREADS) mine = max(mine, inverse_depth(means[at]));
        atomicMax(&greatest, mine);
        __syncthreads();
        bits = greatest;
    }
    float nearest = __uint_as_float(bits), scale = bits ? 255 / nearest : 0;
    u8* codes = f.pixels + 8 * count;
    for (u32 at = threadIdx.x; at < count; at += DEPTH_THREADS)
        codes[at] = (u8)fminf(__uint_as_float(inverse_depth(means[at])) * scale + 0.5f, 255.f);
    if (threadIdx.x == 0) f.status[2] = bits;
}
