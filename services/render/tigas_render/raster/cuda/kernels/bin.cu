// Writes the lists: depth and number of every Gaussian that touches a tile, in no particular order within a slice.
#include "frame.cuh"
#include "tiles.cuh"

// Gives every list its place among the entries; the order of tiles does not matter, that of a tile's slices does.
extern "C" __global__ void __launch_bounds__(CHUNK) place(const Frame* frame) {
    __shared__ u32 warps[CHUNK / 32], base;
    u32 lists = frame->tiles * frame->slices;
    int lane = threadIdx.x & 31, warp = threadIdx.x / 32;
    for (u32 first = blockIdx.x * CHUNK * 4; first < lists; first += gridDim.x * CHUNK * 4) {
        u32 at = first + threadIdx.x * 4;
        uint4 counts = make_uint4(0, 0, 0, 0);
        if (at < lists) counts = *(const uint4*)&frame->counts[at];
        u32 mine = counts.x + counts.y + counts.z + counts.w, last = mine;
        for (int step = 1; step < 32; step *= 2) {
            u32 other = __shfl_up_sync(ALL, last, step);
            if (lane >= step) last += other;
        }
        if (lane == 31) warps[warp] = last;
        __syncthreads();
        u32 start = last - mine, total = 0;
        for (int w = 0; w < CHUNK / 32; w++) {
            if (w < warp) start += warps[w];
            total += warps[w];
        }
        if (threadIdx.x == 0) base = total ? atomicAdd(&frame->progress->entries, total) : 0;
        __syncthreads();
        start += base;
        uint4 starts = make_uint4(start, start + counts.x, start + counts.x + counts.y, start + mine - counts.w);
        if (at < lists) *(uint4*)&frame->starts[at] = *(uint4*)&frame->ends[at] = starts;
        __syncthreads();
    }
}

template <int TILE>
__device__ __forceinline__ void bin_all(const Frame* frame) {
    __shared__ Frame f;
    __shared__ float4 staged[CHUNK * 3];
    for (int word = threadIdx.x; word < FRAME_WORDS; word += CHUNK) ((u32*)&f)[word] = ((const u32*)frame)[word];
    __syncthreads();
    if (blockIdx.x == 0 && threadIdx.x == 0) f.status[0] = f.progress->entries;
    u32 chosen = f.progress->chosen;
    int lane = threadIdx.x & 31;
    for (u32 chunk = blockIdx.x; chunk < chosen; chunk += gridDim.x) {
        u32 i = f.chosen[chunk] * CHUNK + threadIdx.x;
        ushort4 box = f.boxes[i];
        Splat splat = {};
        u32 depth = 0, slice = 0;
        if (box.z) {
            float4 s0 = f.splats[2 * i], s1 = f.splats[2 * i + 1];
            splat = {s0.x, s0.y, s0.z, s0.w, s1.x, s1.y};
            float z = f.depths[i];
            depth = __float_as_uint(z), slice = f.slice_of[depth_bin(z)];
        }
        u32 first = i - lane;
        for_each_tile<TILE>(f, splat, box, slice, staged + (threadIdx.x / 32) * 96, [&](bool hit, u32 list, int owner) {
            u32 its_depth = __shfl_sync(ALL, depth, owner);
            // lanes with the same list take their places together
            u32 peers = __match_any_sync(ALL, hit ? list : ALL);
            int leader = __ffs(peers) - 1;
            u32 at = 0;
            if (hit && leader == lane) at = atomicAdd(&f.ends[list], __popc(peers));
            at = __shfl_sync(ALL, at, leader) + __popc(peers & ((1u << lane) - 1));
            if (hit && at < f.capacity) f.entries[at] = (u64)its_depth << 32 | (first + owner);
        });
    }
}

extern "C" __global__ void __launch_bounds__(CHUNK) bin_16(const Frame* frame) { bin_all<16>(frame); }
extern "C" __global__ void __launch_bounds__(CHUNK) bin_8(const Frame* frame) { bin_all<8>(frame); }
