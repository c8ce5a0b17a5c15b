// The frame's first kernel: fetch its parameters from pinned memory and clear the counters.
#include "frame.cuh"

// Launched with any number of blocks. `pinned` is host memory that the device reads over the bus.
extern "C" __global__ void begin(const Frame* pinned, Frame* frame) {
    u32 thread = blockIdx.x * blockDim.x + threadIdx.x;
    if (blockIdx.x == 0)
        for (int word = threadIdx.x; word < FRAME_WORDS; word += blockDim.x)
            ((u32*)frame)[word] = ((const u32*)pinned)[word];
    u32 tiles = pinned->tiles;
    u32* counts = pinned->tile_counts;
    for (u32 tile = thread; tile < tiles; tile += gridDim.x * blockDim.x) counts[tile] = 0;
    if (thread < 2) pinned->progress[thread] = 0;
}
