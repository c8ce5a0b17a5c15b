// Hands out the tiles of a warp's 32 Gaussians evenly to its 32 lanes, so that a large Gaussian holds up nobody.
#pragma once
#include "frame.cuh"

// Calls `visit(hit, list, owner)` with, in each lane, another of the tiles that the 32 lanes' splats may touch: whether
// it does, the tile's list for the splat's slice of depth, and the lane whose splat it is. All lanes call it together,
// each with its own splat and its box of tiles (first x, first y, columns, rows; no columns: nothing to draw).
// staged: [32, 3] of shared memory, this warp's own.
template <int TILE, class Visit>
__device__ __forceinline__ void for_each_tile(
    const Frame& frame, const Splat& splat, ushort4 box, u32 slice, float4* staged, Visit visit
) {
    int lane = threadIdx.x & 31;
    u32 candidates = (u32)box.z * box.w, last = candidates;
    for (int step = 1; step < 32; step *= 2) {
        u32 other = __shfl_up_sync(ALL, last, step);
        if (lane >= step) last += other;
    }
    u32 total = __shfl_sync(ALL, last, 31);
    if (total == 0) return;
    staged[3 * lane] = make_float4(splat.u, splat.v, splat.a, splat.b);
    staged[3 * lane + 1] = make_float4(splat.c, splat.log_alpha, __uint_as_float(last - candidates), __uint_as_float(slice));
    ((ushort4*)staged)[6 * lane + 4] = box;
    __syncwarp();
    for (u32 first = 0; first < total; first += 32) {
        u32 candidate = first + lane;
        int owner = 0;  // the number of lanes whose candidates all come before this one
        for (int step = 16; step; step /= 2)
            if (__shfl_sync(ALL, last, owner + step - 1) <= candidate) owner += step;
        bool hit = candidate < total;
        u32 list = 0;
        if (hit) {
            float4 s0 = staged[3 * owner], s1 = staged[3 * owner + 1];
            ushort4 b = ((ushort4*)staged)[6 * owner + 4];
            u32 index = candidate - __float_as_uint(s1.z);
            u32 row = index / b.z, tx = b.x + index - row * b.z, ty = b.y + row;
            float x0 = tx * TILE + 0.5f, y0 = ty * TILE + 0.5f;
            float x1 = fminf(x0 + TILE - 1, frame.width - 0.5f), y1 = fminf(y0 + TILE - 1, frame.height - 0.5f);
            hit = touches(Splat{s0.x, s0.y, s0.z, s0.w, s1.x, s1.y}, x0, x1, y0, y1);
            list = (ty * frame.tiles_x + tx) * frame.slices + __float_as_uint(s1.w);
        }
        visit(hit, list, owner);
    }
    __syncwarp();
}
