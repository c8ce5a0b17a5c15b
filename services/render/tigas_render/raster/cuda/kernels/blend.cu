// Sorts each tile's lists and blends them front to back. One block a tile. Each warp has 8 × 4 pixels, one a lane; where
// a tile has fewer of those than the block has warps, several warps blend the same pixels, each its part of the depth.
#include "frame.cuh"

constexpr int THREADS = 256, WARPS = THREADS / 32;
constexpr int BIN_BITS = 11, BINS = 1 << BIN_BITS;  // of one histogram over depth
constexpr int BATCH = 2048;                         // entries that are sorted and blended at a time
constexpr int OWN = BATCH / THREADS;                // of them, or of the bins, one thread's
constexpr u64 NONE = ~0ull;

struct Shared {
    u64 keys[BATCH];
    u32 order[BATCH];
    u32 bins[BINS + 1];
    float4 staged[WARPS][32][3];
    u32 warps[WARPS];
    u32 low, high, tile, whole;
};

// A run of entries; the first BATCH of them are read once and stay in registers.
struct Keys {
    const u64* entries;
    u32 n;
    u64 own[OWN];

    __device__ __forceinline__ void read(u64 (&into)[OWN], u32 first) const {
#pragma unroll
        for (int k = 0; k < OWN; k++) {
            u32 at = first + k * THREADS + threadIdx.x;
            into[k] = at < n ? __ldg(&entries[at]) : NONE;
        }
    }

    __device__ __forceinline__ Keys(const u64* entries, u32 n) : entries(entries), n(n) { read(own, 0); }

    template <class Visit>
    __device__ __forceinline__ void each(Visit visit) const {
#pragma unroll
        for (int k = 0; k < OWN; k++)
            if (own[k] != NONE) visit(own[k]);
        for (u32 first = BATCH; first < n; first += BATCH) {
            u64 more[OWN];
            read(more, first);
#pragma unroll
            for (int k = 0; k < OWN; k++)
                if (more[k] != NONE) visit(more[k]);
        }
    }
};

// The least and the greatest key of a run, give or take their lower halves.
__device__ __forceinline__ void find_range(Shared& s, const Keys& keys, u64& low, u64& high) {
    if (threadIdx.x == 0) s.low = ALL, s.high = 0;
    __syncthreads();
    u32 nearest = ALL, farthest = 0;
    keys.each([&](u64 key) {
        nearest = min(nearest, (u32)(key >> 32)), farthest = max(farthest, (u32)(key >> 32));
    });
    nearest = __reduce_min_sync(ALL, nearest), farthest = __reduce_max_sync(ALL, farthest);
    if ((threadIdx.x & 31) == 0) atomicMin(&s.low, nearest), atomicMax(&s.high, farthest);
    __syncthreads();
    low = (u64)s.low << 32, high = (u64)s.high << 32 | ALL;
}

// Selects the nearest at most BATCH of the keys in [low, high], sorts them into s.order and moves `low` behind them.
// A bucket sort: depth is nearly even within a slice, so a histogram whose bins hold about one entry sorts almost
// alone, and counting within each bin does the rest. Where one bin alone is more than a batch, its own range is looked
// at more closely, as in radix selection (Alabi et al. 2012); keys are unique, so that ends.
// On the run's first batch, finds [low, high]. Returns the number of entries in s.order.
__device__ __forceinline__ u32 next_batch(Shared& s, const u64* entries, u32 n, bool first, u64& low, u64& high) {
    int lane = threadIdx.x & 31, warp = threadIdx.x / 32;
    Keys keys(entries, n);
    if (first) find_range(s, keys, low, high);
    u64 to = high;
    while (true) {
        int shift = max(64 - __clzll(to - low) - BIN_BITS, 0);  // (to - low) >> shift < BINS
        for (int bin = threadIdx.x; bin < BINS; bin += THREADS) s.bins[bin] = 0;
        __syncthreads();
        keys.each([&](u64 key) {
            if (key >= low && key <= to) atomicAdd(&s.bins[(key - low) >> shift], 1);
        });
        __syncthreads();
        // exclusive scan of the bins
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
        __syncthreads();
        if (whole == 0) {
            to = low + ((u64)1 << shift) - 1;
            continue;
        }
        keys.each([&](u64 key) {
            u64 bin = (key - low) >> shift;
            if (key >= low && key <= to && bin < whole) s.keys[atomicAdd(&s.bins[bin], 1)] = key;
        });
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

// What a pixel has got so far, and the light that still passes.
struct Pixel {
    float r, g, b, light;
    bool alive;
};

// Blends s.order[from, end) into each lane's pixel. The warp's pixel centres lie in [x0, x1] × [y0, y1].
__device__ __forceinline__ void blend_run(
    const Frame& f, const u32* order, u32 from, u32 end, float4 (*staged)[3], float px, float py,
    float x0, float x1, float y0, float y1, Pixel& pixel
) {
    int lane = threadIdx.x & 31;
    float4 next0, next1;
    bool have = from + lane < end;
    if (have) {
        u32 i = order[from + lane];
        next0 = f.splats[2 * i], next1 = f.splats[2 * i + 1];
    }
    for (u32 first = from; first < end; first += 32) {
        if (!__any_sync(ALL, pixel.alive)) break;
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
        have = first + 32 + lane < end;
        if (have) {
            u32 i = order[first + 32 + lane];
            next0 = f.splats[2 * i], next1 = f.splats[2 * i + 1];
        }
        __syncwarp();
        int count = __popc(hits);
        for (int k = 0; k < count; k++) {
            float4 a = staged[k][0], c = staged[k][1];
            float dx = px - a.x, dy = py - a.y;
            float falloff = dx * (a.z * dx + a.w * dy) + c.x * dy * dy;
            float log_alpha = c.y - falloff;
            if (pixel.alive && log_alpha >= LOG2_ALPHA_MIN && falloff >= 0) {
                float alpha;
                asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(alpha) : "f"(log_alpha));
                alpha = fminf(alpha, ALPHA_MAX);
                float after = pixel.light * (1 - alpha);
                if (after <= TRANSMITTANCE_MIN) {
                    pixel.alive = false;  // not drawn, and the pixel ends [gsplat]
                } else {
                    float weight = alpha * pixel.light;
                    pixel.r += weight * c.z, pixel.g += weight * c.w, pixel.b += weight * staged[k][2].x;
                    pixel.light = after;
                }
            }
        }
        __syncwarp();
    }
}

template <int TILE>
__device__ __forceinline__ void blend_all(const Frame* frame) {
    constexpr int REGIONS = TILE * TILE / 32, PARTS = WARPS / REGIONS;
    __shared__ Frame f;
    __shared__ Shared s;
    for (int word = threadIdx.x; word < FRAME_WORDS; word += THREADS) ((u32*)&f)[word] = ((const u32*)frame)[word];
    float4(*partial)[32] = (float4(*)[32])s.keys;  // free while blending
    int lane = threadIdx.x & 31, warp = threadIdx.x / 32;
    int region = warp / PARTS, part = warp % PARTS;
    __syncthreads();
    if (blockIdx.x == 0 && threadIdx.x == 0) f.progress->chosen = 0;  // for the next frame
    while (true) {
        if (threadIdx.x == 0) s.tile = atomicAdd(&f.progress->tiles, 1);
        __syncthreads();
        u32 tile = s.tile;
        if (tile >= f.tiles) {
            // Each block comes here once; the last one resets the counter for the next frame.
            if (threadIdx.x == 0 && tile == f.tiles + gridDim.x - 1) f.progress->tiles = 0;
            return;
        }
        int left = tile % f.tiles_x * TILE + region % (TILE / 8) * 8;
        int top = tile / f.tiles_x * TILE + region / (TILE / 8) * 4;
        int x = left + (lane & 7), y = top + lane / 8;
        bool inside = x < f.width && y < f.height;
        float px = x + 0.5f, py = y + 0.5f;
        float x0 = left + 0.5f, x1 = fminf(x0 + 7, f.width - 0.5f), y0 = top + 0.5f, y1 = fminf(y0 + 3, f.height - 0.5f);
        Pixel pixel = {0, 0, 0, 1, inside};

        const u32* ends = f.ends + (u64)tile * f.slices;
        u32 at = min(f.starts[(u64)tile * f.slices], f.capacity);
        u32 my_end = threadIdx.x < f.slices ? min(ends[threadIdx.x], f.capacity) : ALL;
        bool more = true;
        while (more) {
            // As many slices as fit in a batch; or the next one alone, if it is longer than that.
            u32 fit = __syncthreads_count(threadIdx.x < f.slices && my_end <= at + BATCH);
            u32 end = fit ? min(ends[fit - 1], f.capacity) : at;
            if (end == at && fit < f.slices) end = min(ends[fit], f.capacity);
            if (end == at) break;
            const u64* entries = f.entries + at;
            u32 n = end - at;
            at = end;
            u64 low = 0, high = 0;
            for (u32 done = 0; done < n && more;) {
                u32 taken = next_batch(s, entries, n, done == 0, low, high);
                done += taken;
                if (PARTS == 1) {
                    blend_run(f, s.order, 0, taken, s.staged[warp], px, py, x0, x1, y0, y1, pixel);
                } else {
                    u32 length = (taken + PARTS - 1) / PARTS;
                    Pixel mine = {0, 0, 0, 1, pixel.alive};
                    blend_run(f, s.order, min(part * length, taken), min((part + 1) * length, taken), s.staged[warp],
                              px, py, x0, x1, y0, y1, mine);
                    partial[warp][lane] = make_float4(mine.r, mine.g, mine.b, mine.light);
                    __syncthreads();
                    for (int p = 0; p < PARTS; p++) {
                        float4 other = partial[region * PARTS + p][lane];
                        pixel.r += pixel.light * other.x, pixel.g += pixel.light * other.y;
                        pixel.b += pixel.light * other.z, pixel.light *= other.w;
                    }
                    pixel.alive = inside && pixel.light > TRANSMITTANCE_MIN;
                }
                more = __syncthreads_or(pixel.alive);
            }
        }
        if (part == 0)
            store(f, x, y, inside, pixel.r + pixel.light * f.background[0], pixel.g + pixel.light * f.background[1],
                  pixel.b + pixel.light * f.background[2]);
        __syncthreads();
    }
}

extern "C" __global__ void __launch_bounds__(THREADS, 4) blend_16(const Frame* frame) { blend_all<16>(frame); }
extern "C" __global__ void __launch_bounds__(THREADS, 4) blend_8(const Frame* frame) { blend_all<8>(frame); }
