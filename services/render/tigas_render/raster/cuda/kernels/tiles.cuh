// Hands out the tiles of a block's Gaussians evenly to its threads, so that a large Gaussian holds up nobody.
#pragma once
#include "frame.cuh"

// Gaussians that may touch more tiles than this are taken up by the whole block, the others by their own warp.
constexpr u32 LARGE = 64;

struct TileWork {
    float4 staged[CHUNK][3];  // a Gaussian's splat, its first candidate, slice, box and depth
    u32 large[CHUNK];
    u32 large_count;
};

// Calls `visit(hit, list, owner, depth)` with, in each lane, another of the tiles that the block's splats may touch:
// whether it does, the tile's list for the splat's slice of depth, the thread whose splat it is, and its depth.
// All threads call it together, each with its own splat and its box of tiles (first x, first y, columns, rows; no
// columns: nothing to draw).
template <int TILE, class Visit>
__device__ __forceinline__ void for_each_tile(
    const Frame& f, const Splat& splat, ushort4 box, u32 slice, float depth, TileWork& work, Visit visit
) {
    int lane = threadIdx.x & 31, warp_first = threadIdx.x - lane;
    u32 candidates = (u32)box.z * box.w;
    if (threadIdx.x == 0) work.large_count = 0;
    __syncthreads();
    bool large = candidates > LARGE;
    if (large) work.large[atomicAdd(&work.large_count, 1)] = threadIdx.x;
    if (large) candidates = 0;
    u32 last = candidates;
    for (int step = 1; step < 32; step *= 2) {
        u32 other = __shfl_up_sync(ALL, last, step);
        if (lane >= step) last += other;
    }
    float4* mine = work.staged[threadIdx.x];
    if (box.z) {
        mine[0] = make_float4(splat.u, splat.v, splat.a, splat.b);
        mine[1] = make_float4(splat.c, splat.log_alpha, __uint_as_float(last - candidates), __uint_as_float(slice));
        mine[2] = make_float4(__uint_as_float(box.x | (u32)box.y << 16), __uint_as_float(box.z | (u32)box.w << 16), depth, 0);
    }
    __syncthreads();
    auto look = [&](bool valid, u32 owner, u32 candidate, bool from_first) {
        bool hit = false;
        u32 list = 0;
        float its_depth = 0;
        if (valid) {
            float4 s0 = work.staged[owner][0], s1 = work.staged[owner][1], s2 = work.staged[owner][2];
            u32 corner = __float_as_uint(s2.x), columns = __float_as_uint(s2.y) & 0xffff;
            if (from_first) candidate -= __float_as_uint(s1.z);
            u32 row = candidate / columns, tx = (corner & 0xffff) + candidate - row * columns, ty = (corner >> 16) + row;
            float x0 = tx * TILE + 0.5f, y0 = ty * TILE + 0.5f;
            float x1 = fminf(x0 + TILE - 1, f.width - 0.5f), y1 = fminf(y0 + TILE - 1, f.height - 0.5f);
            hit = touches(Splat{s0.x, s0.y, s0.z, s0.w, s1.x, s1.y}, x0, x1, y0, y1);
            list = (ty * f.tiles_x + tx) * f.slices + __float_as_uint(s1.w);
            its_depth = s2.z;
        }
        visit(hit, list, owner, its_depth);
    };
    u32 total = __shfl_sync(ALL, last, 31);
    for (u32 first = 0; first < total; first += 32) {
        u32 candidate = first + lane;
        int owner = 0;  // the number of lanes whose candidates all come before this one
        for (int step = 16; step; step /= 2)
            if (__shfl_sync(ALL, last, owner + step - 1) <= candidate) owner += step;
        look(candidate < total, warp_first + owner, candidate, true);
    }
    u32 count = work.large_count;
    for (u32 k = 0; k < count; k++) {
        u32 owner = work.large[k], size = __float_as_uint(work.staged[owner][2].y);
        size = (size & 0xffff) * (size >> 16);
        for (u32 first = 0; first < size; first += CHUNK)
            look(first + threadIdx.x < size, owner, first + threadIdx.x, false);
    }
    __syncthreads();
}
