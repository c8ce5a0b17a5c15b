// Writes each tile's list: depth and number of every Gaussian that touches it, in no particular order.
#include "frame.cuh"
#include "tiles.cuh"

template <int TILE>
__device__ __forceinline__ void bin_all(const Frame* frame) {
    __shared__ Frame f;
    __shared__ float4 staged[CHUNK * 3];
    for (int word = threadIdx.x; word < FRAME_WORDS; word += CHUNK) ((u32*)&f)[word] = ((const u32*)frame)[word];
    __syncthreads();
    for (u32 chunk = blockIdx.x; chunk < f.chunks; chunk += gridDim.x) {
        if (!f.chunk_visible[chunk]) continue;
        u32 i = chunk * CHUNK + threadIdx.x;
        ushort4 box = f.boxes[i];
        Splat splat = {};
        u32 depth = 0;
        if (box.z) {
            float4 s0 = f.splats[2 * i], s1 = f.splats[2 * i + 1];
            splat = {s0.x, s0.y, s0.z, s0.w, s1.x, s1.y};
            depth = __float_as_uint(f.depths[i]);
        }
        u32 first = i - (threadIdx.x & 31);
        for_each_tile<TILE>(f, splat, box, staged + (threadIdx.x / 32) * 96, [&](bool hit, u32 tile, int owner) {
            u32 its_depth = __shfl_sync(ALL, depth, owner & 31);
            if (!hit) return;
            u32 at = atomicAdd(&f.tile_ends[tile], 1);
            if (at < f.capacity) f.entries[at] = (u64)its_depth << 32 | (first + owner);
        });
    }
}

extern "C" __global__ void __launch_bounds__(CHUNK) bin_16(const Frame* frame) { bin_all<16>(frame); }
extern "C" __global__ void __launch_bounds__(CHUNK) bin_8(const Frame* frame) { bin_all<8>(frame); }
