// Sorts each tile's list and blends it front to back. One block a tile, one thread a pixel.
#include "frame.cuh"

template <int TILE>
struct Shared {
    static constexpr int BINS = TILE == 16 ? 2048 : 1024;  // of one histogram over depth, a power of two
    static constexpr int BATCH = BINS;                     // entries that are sorted and blended at a time
    u64 keys[BATCH];
    u32 order[BATCH];
    u32 bins[BINS + 1];
    float4 staged[TILE * TILE / 32][32][3];
    u32 warps[TILE * TILE / 32];
    u32 low, high, tile, whole;
};

// Selects the nearest at most BATCH entries of [low, high], sorts them into s.order and moves `low` behind them.
// A bucket sort: depth is nearly uniform in a tile, so a histogram whose bins hold about one entry sorts almost alone,
// and counting within each bin does the rest. Where one bin alone is more than a batch, its own range is looked at
// more closely, as in radix selection (Alabi et al. 2012); keys are unique, so that ends.
// entries [n]; returns the number of entries in s.order.
template <int TILE>
__device__ __forceinline__ u32 next_batch(Shared<TILE>& s, const u64* entries, u32 n, u64& low, u64 high) {
    constexpr int THREADS = TILE * TILE, BINS = Shared<TILE>::BINS, BATCH = Shared<TILE>::BATCH;
    constexpr int OWN = BINS / THREADS;  // bins that one thread scans
    constexpr int BIN_BITS = TILE == 16 ? 11 : 10;
    static_assert(BINS == 1 << BIN_BITS, "");
    u64 to = high;
    while (true) {
        int bits = 64 - __clzll(to - low);  // (to - low) >> shift < BINS
        int shift = max(bits - BIN_BITS, 0);
        for (int bin = threadIdx.x; bin < BINS; bin += THREADS) s.bins[bin] = 0;
        __syncthreads();
        for (u32 k = threadIdx.x; k < n; k += THREADS) {
            u64 key = __ldg(&entries[k]);
            if (key >= low && key <= to) atomicAdd(&s.bins[(key - low) >> shift], 1);
        }
        __syncthreads();
        // exclusive scan of the bins
        int lane = threadIdx.x & 31, warp = threadIdx.x / 32;
        u32 mine = 0, counts[OWN];
#pragma unroll
        for (int k = 0; k < OWN; k++) mine += counts[k] = s.bins[threadIdx.x * OWN + k];
        u32 last = mine;
        for (int step = 1; step < 32; step *= 2) {
            u32 other = __shfl_up_sync(ALL, last, step);
            if (lane >= step) last += other;
        }
        if (lane == 31) s.warps[warp] = last;
        if (threadIdx.x == 0) s.whole = 0;
        __syncthreads();
        u32 start = last - mine;
        for (int w = 0; w < warp; w++) start += s.warps[w];
        u32 fit = 0;  // bins that end within the batch
#pragma unroll
        for (int k = 0; k < OWN; k++) {
            s.bins[threadIdx.x * OWN + k] = start;
            start += counts[k];
            fit += start <= BATCH;
        }
        if (threadIdx.x == THREADS - 1) s.bins[BINS] = start;
        fit = __reduce_add_sync(ALL, fit);
        if (lane == 0) atomicAdd(&s.whole, fit);
        __syncthreads();
        u32 whole = s.whole, taken = s.bins[whole];
        if (whole == 0) {
            to = low + ((u64)1 << shift) - 1;
            __syncthreads();
            continue;
        }
        __syncthreads();
        for (u32 k = threadIdx.x; k < n; k += THREADS) {
            u64 key = __ldg(&entries[k]);
            if (key < low || key > to) continue;
            u32 bin = (key - low) >> shift;
            if (bin < whole) s.keys[atomicAdd(&s.bins[bin], 1)] = key;
        }
        __syncthreads();
        // each bin now knows its end; its start is the end of the bin before it
        for (u32 k = threadIdx.x; k < taken; k += THREADS) {
            u64 key = s.keys[k];
            u32 bin = (key - low) >> shift;
            u32 from = bin ? s.bins[bin - 1] : 0, end = s.bins[bin], rank = from;
            for (u32 other = from; other < end; other++) rank += s.keys[other] < key;
            s.order[rank] = (u32)key;
        }
        __syncthreads();
        u64 behind = low + ((u64)whole << shift);
        low = whole == BINS || behind > to || behind < low ? to + 1 : behind;
        return taken;
    }
}

// Stores one pixel in the frame's format. All lanes of the warp call it: lanes 1 and 8 apart are neighbours.
__device__ __forceinline__ void store(const Frame& f, int x, int y, bool inside, float r, float g, float b) {
    r = floorf(clamp(r, 0.f, 1.f) * 255 + 0.5f);
    g = floorf(clamp(g, 0.f, 1.f) * 255 + 0.5f);
    b = floorf(clamp(b, 0.f, 1.f) * 255 + 0.5f);
    if (f.format == RGB) {
        if (!inside) return;
        u8* at = f.pixels + 3 * ((u64)y * f.width + x);
        at[0] = (u8)r, at[1] = (u8)g, at[2] = (u8)b;
        return;
    }
    // JFIF: BT.601, full range. Video: BT.709, limited range (ITU-R BT.709-6), as encode/yuv420p.py.
    bool video = f.format == VIDEO_PLANES;
    float kr = video ? 0.2126f : 0.299f, kb = video ? 0.0722f : 0.114f, kg = 1 - kr - kb;
    float luma = kr * r + kg * g + kb * b;
    u64 area = (u64)f.width * f.height;
    if (inside) f.pixels[(u64)y * f.width + x] = (u8)(video ? 16.5f + 219.f / 255 * luma : luma + 0.5f);
    // the mean of four pixels; at an odd edge the last column or row counts twice
    float mean[2] = {r, b};
    float mean_luma = luma;
    bool more_x = (x | 1) < f.width, more_y = (y | 1) < f.height;
    for (int k = 0; k < 3; k++) {
        float value = k == 2 ? luma : mean[k];
        float across = __shfl_xor_sync(ALL, value, 1);
        value += more_x ? across : value;
        float down = __shfl_xor_sync(ALL, value, 8);
        value = 0.25f * (value + (more_y ? down : value));
        if (k == 2) mean_luma = value;
        else mean[k] = value;
    }
    if (!inside || (x & 1) || (y & 1)) return;
    float range = video ? 224.f / 255 : 1.f;
    float blue = 128.5f + range * 0.5f * (mean[1] - mean_luma) / (1 - kb);
    float red = 128.5f + range * 0.5f * (mean[0] - mean_luma) / (1 - kr);
    int columns = (f.width + 1) / 2, rows = (f.height + 1) / 2;
    u8* at = f.pixels + area + (u64)(y / 2) * columns + x / 2;
    at[0] = (u8)clamp(blue, 0.f, 255.f);
    at[(u64)rows * columns] = (u8)clamp(red, 0.f, 255.f);
}

template <int TILE>
__device__ __forceinline__ void blend_all(const Frame* frame) {
    constexpr int THREADS = TILE * TILE;
    __shared__ Frame f;
    __shared__ Shared<TILE> s;
    for (int word = threadIdx.x; word < FRAME_WORDS; word += THREADS) ((u32*)&f)[word] = ((const u32*)frame)[word];
    int lane = threadIdx.x & 31, warp = threadIdx.x / 32;
    float4(*staged)[3] = s.staged[warp];
    while (true) {
        __syncthreads();
        if (threadIdx.x == 0) {
            s.tile = atomicAdd(&f.progress[1], 1);
            s.low = ALL, s.high = 0;
        }
        __syncthreads();
        u32 tile = s.tile;
        if (tile >= f.tiles) return;
        u32 begin = min(f.tile_starts[tile], f.capacity), n = min(f.tile_ends[tile], f.capacity) - begin;
        const u64* entries = f.entries + begin;
        // Each warp has 8 × 4 pixels.
        int left = tile % f.tiles_x * TILE + warp % (TILE / 8) * 8, top = tile / f.tiles_x * TILE + warp / (TILE / 8) * 4;
        int x = left + (lane & 7), y = top + lane / 8;
        bool inside = x < f.width && y < f.height;
        float px = x + 0.5f, py = y + 0.5f;
        float x0 = left + 0.5f, x1 = fminf(x0 + 7, f.width - 0.5f), y0 = top + 0.5f, y1 = fminf(y0 + 3, f.height - 0.5f);
        float r = 0, g = 0, b = 0, light = 1;  // light: the transmittance so far
        bool alive = inside;

        u32 nearest = ALL, farthest = 0;
        for (u32 k = threadIdx.x; k < n; k += THREADS) {
            u32 depth = (u32)(__ldg(&entries[k]) >> 32);
            nearest = min(nearest, depth), farthest = max(farthest, depth);
        }
        nearest = __reduce_min_sync(ALL, nearest), farthest = __reduce_max_sync(ALL, farthest);
        if (lane == 0) atomicMin(&s.low, nearest), atomicMax(&s.high, farthest);
        __syncthreads();
        u64 low = (u64)s.low << 32, high = (u64)s.high << 32 | ALL;

        u32 left_over = n;
        while (left_over) {
            u32 taken = next_batch<TILE>(s, entries, n, low, high);
            left_over -= taken;
            if (__any_sync(ALL, alive)) {
                float4 next0, next1;
                bool have = lane < taken;
                if (have) {
                    u32 i = s.order[lane];
                    next0 = f.splats[2 * i], next1 = f.splats[2 * i + 1];
                }
                for (u32 first = 0; first < taken; first += 32) {
                    // Each lane looks at one splat: whether it touches this warp's pixels at all.
                    float4 s0 = next0, s1 = next1;
                    bool hit = have && touches(Splat{s0.x, s0.y, s0.z, s0.w, s1.x, s1.y}, x0, x1, y0, y1);
                    u32 hits = __ballot_sync(ALL, hit);
                    if (hit) {
                        int at = __popc(hits & ((1u << lane) - 1));
                        u32 red_green = __float_as_uint(s1.z);
                        staged[at][0] = s0;
                        staged[at][1] = make_float4(s1.x, s1.y, from_half(red_green), from_half(red_green >> 16));
                        staged[at][2].x = from_half(__float_as_uint(s1.w));
                    }
                    // the next splats are on their way while these are drawn
                    have = first + 32 + lane < taken;
                    if (have) {
                        u32 i = s.order[first + 32 + lane];
                        next0 = f.splats[2 * i], next1 = f.splats[2 * i + 1];
                    }
                    __syncwarp();
                    int count = __popc(hits);
                    for (int k = 0; k < count; k++) {
                        float4 a = staged[k][0], c = staged[k][1];
                        float dx = px - a.x, dy = py - a.y;
                        float falloff = dx * (a.z * dx + a.w * dy) + c.x * dy * dy;
                        float log_alpha = c.y - falloff;
                        if (alive && log_alpha >= LOG2_ALPHA_MIN && falloff >= 0) {
                            float alpha;
                            asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(alpha) : "f"(log_alpha));
                            alpha = fminf(alpha, ALPHA_MAX);
                            float after = light * (1 - alpha);
                            if (after <= TRANSMITTANCE_MIN) {
                                alive = false;  // not drawn, and the pixel ends [gsplat]
                            } else {
                                float weight = alpha * light;
                                r += weight * c.z, g += weight * c.w, b += weight * staged[k][2].x;
                                light = after;
                            }
                        }
                    }
                    __syncwarp();
                    if (!__any_sync(ALL, alive)) break;
                }
            }
            if (!__syncthreads_or(alive)) break;
        }
        store(f, x, y, inside, r + light * f.background[0], g + light * f.background[1], b + light * f.background[2]);
    }
}

extern "C" __global__ void __launch_bounds__(256) blend_16(const Frame* frame) { blend_all<16>(frame); }
extern "C" __global__ void __launch_bounds__(64) blend_8(const Frame* frame) { blend_all<8>(frame); }
