// Writes the lists: depth and slot of every Gaussian that touches a tile, in arbitrary order within a slice.
#include "frame.cuh"
#include "tiles.cuh"

// Queues the segments of each lane's tile, so that all first segments are blended first, then all second ones, and so
// on. When a later segment is started, it is usually known whether light still reaches it.
__device__ __forceinline__ void queue_tiles(const Frame& f, u32 tile, u32 entries) {
    int lane = threadIdx.x & 31;
    u32 segments = entries ? (entries - 1) / segment_length(*f.progress, entries) + 1 : 0;
    u32 votes = __ballot_sync(ALL, segments > 0), base = 0;
    if (lane == 0 && votes) base = atomicAdd(&f.progress->queued[0], __popc(votes));
    base = __shfl_sync(ALL, base, 0);
    if (segments > 0) f.queue[base + __popc(votes & ((1u << lane) - 1))] = tile;
    if (segments > 1) {
        f.partial_of[tile] = atomicAdd(&f.progress->partials, segments);
        f.finished[tile] = 0;
    }
    // the other segments, tile by tile, with one segment per lane
    for (u32 left = __ballot_sync(ALL, segments > 1); left; left &= left - 1) {
        int owner = __ffs(left) - 1;
        u32 its_tile = __shfl_sync(ALL, tile, owner), count = __shfl_sync(ALL, segments, owner);
        for (u32 segment = lane; segment < count; segment += 32) {
            f.lights[(u64)its_tile * MAX_SEGMENTS + segment] = 1;
            if (segment) f.queue[(u64)segment * f.tiles + atomicAdd(&f.progress->queued[segment], 1)] = its_tile;
        }
    }
}

// Assigns every list its place among the entries: tiles in arbitrary order, but a tile's slices one after the other.
// Then queues the tiles for blending. A block processes CHUNK * 4 lists at a time, of whole tiles.
extern "C" __global__ void __launch_bounds__(CHUNK) place(const Frame* frame) {
    __shared__ Frame f;
    // Sums have 64 bits, since a frame with more entries than fit in 32 bits must not look like a small one.
    __shared__ u64 warps[CHUNK / 32], ends[CHUNK];
    __shared__ u32 base;
    for (int word = threadIdx.x; word < FRAME_WORDS; word += CHUNK) ((u32*)&f)[word] = ((const u32*)frame)[word];
    __syncthreads();
    u32 lists = f.tiles * f.slices;
    int lane = threadIdx.x & 31, warp = threadIdx.x / 32;
    for (u32 first = blockIdx.x * CHUNK * 4; first < lists; first += gridDim.x * CHUNK * 4) {
        u32 at = first + threadIdx.x * 4;
        uint4 counts = make_uint4(0, 0, 0, 0);
        if (at < lists) counts = *(const uint4*)&f.counts[at];
        u64 mine = (u64)counts.x + counts.y + counts.z + counts.w, last = mine;
        for (int step = 1; step < 32; step *= 2) {
            u64 other = __shfl_up_sync(ALL, last, step);
            if (lane >= step) last += other;
        }
        if (lane == 31) warps[warp] = last;
        __syncthreads();
        u64 start = last - mine, total = 0;
        for (int w = 0; w < CHUNK / 32; w++) {
            if (w < warp) start += warps[w];
            total += warps[w];
        }
        if (threadIdx.x == 0) base = total ? (u32)atomicAdd(&f.progress->entries, total) : 0;
        ends[threadIdx.x] = start + mine;
        __syncthreads();
        u32 entries = 0;  // of the tile whose first slice is this thread's
        if (at < lists && at % f.slices == 0) entries = (u32)(ends[threadIdx.x + f.slices / 4 - 1] - start);
        queue_tiles(f, at / f.slices, entries);
        u32 from = base + (u32)start;
        uint4 starts = make_uint4(from, from + counts.x, from + counts.x + counts.y, from + (u32)mine - counts.w);
        if (at < lists) *(uint4*)&f.starts[at] = *(uint4*)&f.ends[at] = starts;
        __syncthreads();
    }
}

__device__ __forceinline__ void write_entry(const Frame& f, u32 at, float depth, u32 slot) {
    if (at < f.capacity) f.entries[at] = (u64)__float_as_uint(depth) << 32 | slot;
}

template <int TILE>
__device__ __forceinline__ void bin_all(const Frame* frame) {
    __shared__ Frame f;
    __shared__ Staged staged[CHUNK];
    for (int word = threadIdx.x; word < FRAME_WORDS; word += CHUNK) ((u32*)&f)[word] = ((const u32*)frame)[word];
    __syncthreads();
    if (blockIdx.x == 0 && threadIdx.x == 0)
        *(uint2*)f.status = make_uint2((u32)min(f.progress->entries, 0xffffffffull), f.progress->chosen);
    u32 chosen = min(f.progress->chosen, f.room);
    int lane = threadIdx.x & 31;
    for_each_large<TILE>(f, [&](bool hit, u32 list, u32 slot, float depth) {
        if (hit) write_entry(f, atomicAdd(&f.ends[list], 1), depth, slot);
    });
    for (u32 k = blockIdx.x; k < chosen; k += gridDim.x) {
        u32 slot = k * CHUNK + threadIdx.x;
        ushort4 box = f.boxes[slot];
        float4 s0, s1;
        float depth = 0;
        if (box.z) s0 = f.splats[2 * slot], s1 = f.splats[2 * slot + 1], depth = f.depths[slot];
        auto enter = [&](bool hit, u32 list, u32 owner, float its_depth) {
            // lanes with the same list reserve their places together
            u32 peers = __match_any_sync(ALL, hit ? list : ALL);
            int leader = __ffs(peers) - 1;
            u32 at = 0;
            if (hit && leader == lane) at = atomicAdd(&f.ends[list], __popc(peers));
            at = __shfl_sync(ALL, at, leader) + __popc(peers & ((1u << lane) - 1));
            if (hit) write_entry(f, at, its_depth, slot - lane + owner);
        };
        for_each_tile<TILE>(f, s0, s1, box, depth, staged + (threadIdx.x & ~31), enter);
    }
}

extern "C" __global__ void __launch_bounds__(CHUNK) bin_16(const Frame* frame) { bin_all<16>(frame); }
extern "C" __global__ void __launch_bounds__(CHUNK) bin_8(const Frame* frame) { bin_all<8>(frame); }
