// Sorts the tiles' entries and blends them front to back. A block processes one segment of a tile at a time. Each warp
// has 8 × 4 pixels, one per lane. If a tile has fewer such regions than the block has warps, several warps blend the
// same pixels, each over a part of the depth. Parts are blended separately and combined in order, because "over" is
// associative (Porter and Duff 1984).
#include "frame.cuh"
#include "pixels.cuh"

constexpr int THREADS = 256, WARPS = THREADS / 32;
constexpr int BIN_BITS = 11, BINS = 1 << BIN_BITS;  // of one histogram over depth
constexpr int BATCH = 2048;                         // entries that are sorted and blended at a time
constexpr int OWN = BATCH / THREADS;                // entries, or bins, per thread
constexpr u32 STEP = 512;                           // entries between two checks of whether light still passes
constexpr u32 FEW = 128;                            // up to this number, entries are sorted by comparing all pairs
constexpr u64 NONE = ~0ull;

struct __align__(16) Shared {
    u64 keys[BATCH];
    u32 order[BATCH];
    u32 bins[BINS + 1];
    float4 staged[WARPS][32][3];
    u32 warps[WARPS];
    u32 queued[MAX_SEGMENTS];
    u32 low, high, ticket, whole;
};

// A run of entries, of which the first BATCH are read once and stay in registers.
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

// Bounds on the keys of a run, from the minimum and maximum of their upper halves.
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

// Selects up to BATCH of the nearest keys in [low, high], sorts them into s.order, and moves `low` past them.
// This is a bucket sort: depths are distributed almost evenly within a slice, so a histogram with about one entry per
// bin does most of the sorting, and counting within each bin does the rest. If a single bin exceeds a batch, its range
// is divided again, as in radix selection (Alabi et al. 2012), which terminates because keys are unique.
// For the first batch of the run, this also finds [low, high]. Returns the number of entries in s.order.
__device__ __forceinline__ u32 next_batch(Shared& s, const u64* entries, u32 n, bool first, u64& low, u64& high) {
    int lane = threadIdx.x & 31, warp = threadIdx.x / 32;
    if (n <= FEW) {  // each thread counts the keys before its own
        u64 key = threadIdx.x < n ? __ldg(&entries[threadIdx.x]) : NONE;
        if (threadIdx.x < FEW) s.keys[threadIdx.x] = key;
        __syncthreads();
        u32 rank = 0;
        for (u32 other = 0; other < n; other += 2) {
            ulonglong2 two = *(const ulonglong2*)&s.keys[other];
            rank += (two.x < key) + (two.y < key);
        }
        if (threadIdx.x < n) s.order[rank] = (u32)key;
        __syncthreads();
        return n;
    }
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
        // s.bins now has the end of each bin, which is the start of the next one
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

// A pixel's colour so far, and its transmittance.
struct Pixel {
    float r, g, b, light;
    bool alive;
};

// Blends s.order[from, end) into each lane's pixel. The warp's pixel centres are in [x0, x1] × [y0, y1].
__device__ __forceinline__ void blend_run(
    const Frame& f, const u32* order, u32 from, u32 end, float4 (*staged)[3], float px, float py,
    float x0, float x1, float y0, float y1, Pixel& pixel
) {
    constexpr float ENDED = 1e30f;  // no logarithm is as large
    int lane = threadIdx.x & 31;
    float least = pixel.alive ? LOG2_ALPHA_MIN : ENDED;
    float4 next0, next1;
    bool have = from + lane < end;
    if (have) {
        u32 slot = order[from + lane];
        next0 = f.splats[2 * slot], next1 = f.splats[2 * slot + 1];
    }
    for (u32 first = from; first < end; first += 32) {
        if (!__any_sync(ALL, least < ENDED)) break;
        // Each lane checks one splat for whether it touches any of this warp's pixels.
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
        // load the next splats while these are drawn
        have = first + 32 + lane < end;
        if (have) {
            u32 slot = order[first + 32 + lane];
            next0 = f.splats[2 * slot], next1 = f.splats[2 * slot + 1];
        }
        __syncwarp();
        int count = __popc(hits);
        for (int k = 0; k < count; k++) {
            float4 a = staged[k][0], c = staged[k][1];
            float dx = px - a.x, dy = py - a.y;
            float log_alpha = c.y - dx * (a.z * dx + a.w * dy) - c.x * dy * dy;
            if (log_alpha >= least) {
                float alpha;
                asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(alpha) : "f"(log_alpha));
                alpha = fminf(alpha, ALPHA_MAX);
                float after = pixel.light * (1 - alpha);
                if (after <= TRANSMITTANCE_MIN) {
                    least = ENDED;  // the splat is not drawn, and the pixel is finished [gsplat]
                } else {
                    float weight = alpha * pixel.light;
                    pixel.r += weight * c.z, pixel.g += weight * c.w, pixel.b += weight * staged[k][2].x;
                    pixel.light = after;
                }
            }
        }
        __syncwarp();
    }
    pixel.alive = least < ENDED;
}

// Blends one segment of a tile to a partial image, as if there were nothing in front of it.
template <int TILE>
struct Blender {
    static constexpr int REGIONS = TILE * TILE / 32, PARTS = WARPS / REGIONS;
    const Frame& f;
    Shared& s;
    int lane, warp, region, part, x, y;
    bool inside;
    float x0, x1, y0, y1;

    __device__ __forceinline__ Blender(const Frame& f, Shared& s, u32 tile) : f(f), s(s) {
        lane = threadIdx.x & 31, warp = threadIdx.x / 32, region = warp / PARTS, part = warp % PARTS;
        int left = tile % f.tiles_x * TILE + region % (TILE / 8) * 8;
        int top = tile / f.tiles_x * TILE + region / (TILE / 8) * 4;
        x = left + (lane & 7), y = top + lane / 8;
        inside = x < f.width && y < f.height;
        x0 = left + 0.5f, x1 = fminf(x0 + 7, f.width - 0.5f), y0 = top + 0.5f, y1 = fminf(y0 + 3, f.height - 0.5f);
    }

    // Blends unsorted entries [n]. All warps of a region end up with the same pixels.
    __device__ __forceinline__ Pixel blend(const u64* entries, u32 n) {
        Pixel pixel = {0, 0, 0, 1, inside};
        float(*partial)[32][4] = (float(*)[32][4])s.keys;  // free while blending
        u64 low = 0, high = 0;
        bool more = true;
        for (u32 done = 0; done < n && more;) {
            u32 taken = next_batch(s, entries, n, done == 0, low, high);
            done += taken;
            if (PARTS == 1) {
                blend_run(f, s.order, 0, taken, s.staged[warp], x + 0.5f, y + 0.5f, x0, x1, y0, y1, pixel);
            } else {
                for (u32 from = 0; from < taken; from += STEP) {
                    u32 end = min(from + STEP, taken), length = (end - from + PARTS - 1) / PARTS;
                    Pixel mine = {0, 0, 0, 1, pixel.alive};
                    blend_run(f, s.order, min(from + part * length, end), min(from + (part + 1) * length, end),
                              s.staged[warp], x + 0.5f, y + 0.5f, x0, x1, y0, y1, mine);
                    *(float4*)partial[warp][lane] = make_float4(mine.r, mine.g, mine.b, mine.light);
                    __syncthreads();
                    for (int p = 0; p < PARTS; p++) add(pixel, *(float4*)partial[region * PARTS + p][lane]);
                    pixel.alive = inside && pixel.light > TRANSMITTANCE_MIN;
                    if (end < taken && !__syncthreads_or(pixel.alive)) break;
                }
            }
            more = done < n && __syncthreads_or(pixel.alive);
        }
        return pixel;
    }

    // Blends a partial image behind the pixel's colour.
    __device__ __forceinline__ void add(Pixel& pixel, float4 behind) {
        if (pixel.light <= TRANSMITTANCE_MIN) return;
        pixel.r += pixel.light * behind.x, pixel.g += pixel.light * behind.y, pixel.b += pixel.light * behind.z;
        pixel.light *= behind.w;
    }

    __device__ __forceinline__ void finish(const Pixel& pixel) {
        if (part == 0)
            store(f, x, y, inside, pixel.r + pixel.light * f.background[0], pixel.g + pixel.light * f.background[1],
                  pixel.b + pixel.light * f.background[2]);
    }
};

template <int TILE>
__device__ __forceinline__ void blend_all(const Frame* frame) {
    constexpr int AREA = TILE * TILE;
    __shared__ Frame f;
    __shared__ Shared s;
    for (int word = threadIdx.x; word < FRAME_WORDS; word += THREADS) ((u32*)&f)[word] = ((const u32*)frame)[word];
    __syncthreads();
    if (threadIdx.x < MAX_SEGMENTS) s.queued[threadIdx.x] = f.progress->queued[threadIdx.x];
    if (blockIdx.x == 0 && threadIdx.x == 0) f.progress->large = 0;  // for the next frame
    while (true) {
        if (threadIdx.x == 0) s.ticket = atomicAdd(&f.progress->taken, 1);
        __syncthreads();
        u32 ticket = s.ticket, segment = 0, ahead = 0;
        while (segment < MAX_SEGMENTS && ticket >= ahead + s.queued[segment]) ahead += s.queued[segment++];
        if (segment == MAX_SEGMENTS) {
            // Each block gets here once; the last one resets the counters for the next frame.
            if (ticket == ahead + gridDim.x - 1) {
                if (threadIdx.x < MAX_SEGMENTS) f.progress->queued[threadIdx.x] = 0;
                if (threadIdx.x == 0) f.progress->taken = 0;
            }
            return;
        }
        u32 tile = f.queue[(u64)segment * f.tiles + ticket - ahead];
        u64 list = (u64)tile * f.slices;
        u32 first = f.starts[list], n = f.ends[list + f.slices - 1] - first, length = segment_length(*f.progress, n);
        u32 segments = (n - 1) / length + 1;
        float* lights = f.lights + (u64)tile * MAX_SEGMENTS;

        // A segment consists of the slices that begin in its part of the tile's entries.
        if (threadIdx.x == 0) s.low = ALL, s.high = 0;
        bool dark = false;
        if (segment) {  // an upper bound on the light that passes all finished segments before this one
            float light = 1;
            for (u32 k = threadIdx.x & 31; k < segment; k += 32) light *= __ldcg(&lights[k]);
            for (int step = 16; step; step /= 2) light *= __shfl_xor_sync(ALL, light, step);
            dark = light <= TRANSMITTANCE_MIN;
        }
        dark = __syncthreads_or(dark && threadIdx.x < 32);
        if (threadIdx.x < f.slices) {
            u32 start = f.starts[list + threadIdx.x], end = f.ends[list + threadIdx.x];
            if (end > start && (start - first) / length == segment) {
                atomicMin(&s.low, min(start, f.capacity));
                atomicMax(&s.high, min(end, f.capacity));
            }
        }
        __syncthreads();
        u32 from = s.low, end = s.high;
        __syncthreads();
        Blender<TILE> blender(f, s, tile);
        Pixel pixel = {0, 0, 0, 1, false};
        if (from < end && !dark) pixel = blender.blend(f.entries + from, end - from);
        if (segments == 1) {
            blender.finish(pixel);
            continue;
        }
        u32 slot = f.partial_of[tile];
        float4* partials = f.partials + (u64)slot * AREA + blender.region * 32 + blender.lane;
        bool room = slot + segments <= f.capacity / 256;  // otherwise the lists have overflowed: an invalid image
        if (blender.part == 0 && room) partials[segment * AREA] = make_float4(pixel.r, pixel.g, pixel.b, pixel.light);
        u32 most = __reduce_max_sync(ALL, blender.inside ? __float_as_uint(pixel.light) : 0);
        if (threadIdx.x == 0) s.high = 0;
        __threadfence();
        __syncthreads();
        if (blender.lane == 0) atomicMax(&s.high, most);
        __syncthreads();
        if (threadIdx.x == 0) {
            lights[segment] = __uint_as_float(s.high);
            __threadfence();
            s.low = atomicAdd(&f.finished[tile], 1);
        }
        __syncthreads();
        if (s.low == segments - 1 && room) {  // the last segment to finish combines the partial images
            __threadfence();
            pixel = {0, 0, 0, 1, false};
            for (u32 k = 0; k < segments; k++) blender.add(pixel, __ldcg(&partials[k * AREA]));
            blender.finish(pixel);
        }
    }
}

extern "C" __global__ void __launch_bounds__(THREADS, 3) blend_16(const Frame* frame) { blend_all<16>(frame); }
extern "C" __global__ void __launch_bounds__(THREADS, 3) blend_8(const Frame* frame) { blend_all<8>(frame); }
