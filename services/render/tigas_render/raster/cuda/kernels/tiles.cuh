// Distributes the tiles that Gaussians may touch evenly among threads, so that large Gaussians do not hold up others.
#pragma once
#include "frame.cuh"

// Gaussians that may touch more tiles than this get one block each, in a separate pass; the others share a warp.
constexpr u32 LARGE = 32;

__device__ __forceinline__ bool is_large(ushort4 box) { return (u32)box.z * box.w > LARGE; }

// A Gaussian on its way to tiles: its splat, the index of its first candidate, its slice, depth and box of tiles.
struct Staged {
    float4 s0, s1;
    u32 first, slice;
    float depth;
    u16 x, y, columns, rows;
};

// Calls `visit(hit, list, depth)` for one candidate tile: whether the splat touches it, the tile's list for the splat's
// slice of depth, and its depth. All lanes of a warp must call it, without `valid` if they have nothing to do.
template <int TILE, class Visit>
__device__ __forceinline__ void look(const Frame& f, bool valid, const Staged& g, u32 candidate, Visit visit) {
    bool hit = false;
    u32 list = 0;
    float depth = 0;
    if (valid) {
        u32 row = candidate / g.columns, tx = g.x + candidate - row * g.columns, ty = g.y + row;
        float x0 = tx * TILE + 0.5f, y0 = ty * TILE + 0.5f;
        float x1 = fminf(x0 + TILE - 1, f.width - 0.5f), y1 = fminf(y0 + TILE - 1, f.height - 0.5f);
        float4 s0 = g.s0, s1 = g.s1;
        hit = touches(Splat{s0.x, s0.y, s0.z, s0.w, s1.x, s1.y}, x0, x1, y0, y1);
        list = (ty * f.tiles_x + tx) * f.slices + g.slice;
        depth = g.depth;
    }
    visit(hit, list, depth);
}

// Calls `visit(hit, list, owner, depth)`, with the owning lane, for each tile that a warp's 32 splats may touch, like
// `look`. staged [32]: the warp's shared memory. Splats with an empty or large box are skipped.
template <int TILE, class Visit>
__device__ __forceinline__ void for_each_tile(
    const Frame& f, float4 s0, float4 s1, ushort4 box, float depth, Staged* staged, Visit visit
) {
    int lane = threadIdx.x & 31;
    u32 candidates = is_large(box) ? 0 : (u32)box.z * box.w, last = candidates;
    for (int step = 1; step < 32; step *= 2) {
        u32 other = __shfl_up_sync(ALL, last, step);
        if (lane >= step) last += other;
    }
    if (candidates)
        staged[lane] = {s0, s1, last - candidates, f.slice_of[depth_bin(depth)], depth, box.x, box.y, box.z, box.w};
    __syncwarp();
    u32 total = __shfl_sync(ALL, last, 31);
    for (u32 first = 0; first < total; first += 32) {
        u32 candidate = first + lane;
        int owner = 0;  // the number of lanes with candidates that are all before this one
        for (int step = 16; step; step /= 2)
            if (__shfl_sync(ALL, last, owner + step - 1) <= candidate) owner += step;
        bool valid = candidate < total;
        look<TILE>(f, valid, staged[owner], valid ? candidate - staged[owner].first : 0,
                   [&](bool hit, u32 list, float its_depth) { visit(hit, list, owner, its_depth); });
    }
    __syncwarp();
}

// Calls `visit(hit, list, slot, depth)` for each tile that the large Gaussians may touch, with one Gaussian per block.
template <int TILE, class Visit>
__device__ __forceinline__ void for_each_large(const Frame& f, Visit visit) {
    u32 count = f.progress->large;
    for (u32 k = blockIdx.x; k < count; k += gridDim.x) {
        u32 slot = f.large[k];
        ushort4 box = f.boxes[slot];
        float depth = f.depths[slot];
        u32 slice = f.slice_of[depth_bin(depth)];
        Staged g = {f.splats[2 * slot], f.splats[2 * slot + 1], 0, slice, depth, box.x, box.y, box.z, box.w};
        u32 total = (u32)box.z * box.w;
        for (u32 first = 0; first < total; first += CHUNK)
            look<TILE>(f, first + threadIdx.x < total, g, first + threadIdx.x,
                       [&](bool hit, u32 list, float its_depth) { visit(hit, list, slot, its_depth); });
    }
}
