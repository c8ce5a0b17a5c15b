// One frame's parameters and buffers, and the arithmetic that all kernels share.
// No headers are included: NVRTC compiles this on machines without a CUDA toolkit.
#pragma once

typedef unsigned char u8;
typedef unsigned short u16;
typedef unsigned int u32;
typedef unsigned long long u64;

constexpr int CHUNK = 256;  // Gaussians that are neighbours in space, and one block's threads
constexpr u32 ALL = 0xffffffffu;

// The renderer's rules; base.py defines the first four.
constexpr float NEAR_PLANE = 0.01f;
constexpr float LOG2_ALPHA_MIN = -7.9943534f;  // log2(1 / 255)
constexpr float ALPHA_MAX = 0.999f;
constexpr float TRANSMITTANCE_MIN = 1e-4f;
constexpr float FARTHEST = 1e7f;  // centres farther outside have no fractions of a pixel in float32
constexpr float LOG2_E = 1.44269504f;

// Depth in bins that are even in the float's bits: 256 an octave, from 2^-8 to 2^24. Whole bins make up slices.
constexpr int DEPTH_BINS = 8192;

__device__ __forceinline__ u32 depth_bin(float depth) {
    int bin = (__float_as_int(depth) >> 15) - (119 << 8);
    return min(max(bin, 0), DEPTH_BINS - 1);
}

// A tile's entries are blended in segments, side by side. A scene with few Gaussians needs short ones to keep the whole
// device busy; long ones cost less in all.
constexpr u32 MIN_SEGMENT = 512, MAX_SEGMENT = 2048, MAX_SEGMENTS = 64;

// `begin` gives each of its blocks a range of chunks, one after the other; compiler.py launches at most so many blocks.
constexpr u32 MAX_RANGES = 1024;

// Counters that the kernels of a frame share. Each frame leaves the first five members zero; `begin` sets the others.
struct Progress {
    u32 depths[DEPTH_BINS];  // chosen chunks by the depth of their centres
    u32 culled;    // blocks that have finished culling
    u32 large;     // visible Gaussians with many tiles
    u32 taken;     // segments that were taken up for blending
    u32 queued[MAX_SEGMENTS];  // tiles that have a first, second, ... segment
    u32 chosen;    // chunks that may be visible, also if the buffers have no room for all
    u64 entries;   // of all lists together
    u32 partials;  // of tiles that are blended in several segments
    u32 segment;   // entries in one
    u32 range;     // chunks of a block of `begin`
    u32 ranges;    // its blocks
    u32 before[MAX_RANGES];  // chosen chunks before each range
};

// Longer where a tile would have too many of them.
__device__ __forceinline__ u32 segment_length(const Progress& progress, u32 entries) {
    return max(progress.segment, (entries - 1) / MAX_SEGMENTS + 1);
}

// DEPTH: not colours but the means of weight / z and of weight, float [H, W, 2].
enum Format { RGB = 0, JPEG_PLANES = 1, VIDEO_PLANES = 2, DEPTH = 3 };

// One frame: parameters.py writes it (LAYOUT there), `begin` copies it to the device. Pointers first.
struct Frame {
    // the packed scene, see scene.py; padded to whole chunks
    const float* means;     // [3, padded]
    const uint4* shapes;    // [padded] log2 scales, opacity and quaternion, 16 bits each
    const uint2* sh;        // [groups, padded] four half-precision coefficients a group
    const float4* bounds;   // [chunks, 2] centre and radius of a chunk; its greatest deviation, a cell's edge, its parent
    // this frame's intermediate results; `slots` are the Gaussians of the chosen chunks, in the scene's order
    float4* splats;         // [slots, 2] records of visible Gaussians
    float* depths;          // [slots]
    ushort4* boxes;         // [slots] tiles that a Gaussian may touch: first x, first y, columns, rows
    u32* chosen;            // [chunks] those that may be visible, of each range from where the range begins
    u32* large;             // [slots] slots of visible Gaussians with many tiles
    u8* slice_of;           // [DEPTH_BINS] the slice of each depth bin
    u32* counts;            // [tiles, slices] entries of each list
    u32* starts;            // [tiles, slices] where each list begins
    u32* ends;              // [tiles, slices] where it ends; while it is being filled, where it goes on
    u64* entries;           // [capacity] depth << 32 | slot; the lists of one tile lie one after the other
    u32* queue;             // [MAX_SEGMENTS, tiles] tiles with a first, second, ... segment
    u32* partial_of;        // [tiles] where the partial pictures of a tile's segments begin
    u32* finished;          // [tiles] segments that are blended
    float* lights;          // [tiles, MAX_SEGMENTS] the most light that passes a segment at any pixel; 1 until finished
    float4* partials;       // [capacity / 256, side²] red, green, blue, light
    u8* pixels;             // RGB [H, W, 3], three planes, or depth
    u32* status;            // pinned, `Status` of workspace.py: entries needed, at most 2^32 - 1, and chosen chunks
    Progress* progress;
    u32 padded, capacity, room;  // room: chosen chunks that there are slots for
    u32 tiles, tiles_x, slices;  // slices: a power of two, at most 256
    int width, height, format, sh_coefficients;
    float scale_low, scale_step;  // log2 scale = scale_low + scale_step * code
    float rotation[9];      // world to camera, row by row
    float eye[3];
    float fx, fy, cx, cy;
    float dilation, filtered;  // added to a projected covariance, in pixels²: before the low-pass filter, and with it
    float left, right, top, bottom;  // limits of x / z and y / z where the projection's derivative is taken [gsplat]
    float background[3];
    float reach;            // a cell's edge may be as long for each unit of depth; 0: full detail
};

constexpr int FRAME_WORDS = sizeof(Frame) / 4;

__device__ __forceinline__ float from_half(u32 bits) {
    float value;
    asm("cvt.f32.f16 %0, %1;" : "=f"(value) : "h"((u16)bits));
    return value;
}

__device__ __forceinline__ u32 to_half(float value) {
    u16 bits;
    asm("cvt.rn.f16.f32 %0, %1;" : "=h"(bits) : "f"(value));
    return bits;
}

__device__ __forceinline__ float clamp(float value, float low, float high) { return fminf(fmaxf(value, low), high); }

// A projected Gaussian. log2(alpha) at (dx, dy) pixels from its centre is log_alpha - (a dx² + b dx dy + c dy²).
struct Splat {
    float u, v, a, b, c, log_alpha;
};

// Whether the splat's ellipse alpha >= 1/255 reaches the rectangle of pixel centres [x0, x1] × [y0, y1].
// The quadratic is convex, so its least value over the rectangle lies at the centre, or on one of the at most two
// edges that face the centre: exact opacity-aware intersection, as in [StopThePop] (Radl et al. 2024) and
// [Speedy-Splat] (Hanson et al. 2025).
__device__ __forceinline__ bool touches(const Splat& s, float x0, float x1, float y0, float y1) {
    x0 -= s.u, x1 -= s.u, y0 -= s.v, y1 -= s.v;
    float dx = clamp(0.f, x0, x1), dy = clamp(0.f, y0, y1);
    float y_best = clamp(__fdividef(-0.5f * s.b * dx, s.c), y0, y1);  // on the facing vertical edge
    float x_best = clamp(__fdividef(-0.5f * s.b * dy, s.a), x0, x1);  // on the facing horizontal edge
    float on_vertical = s.a * dx * dx + s.b * dx * y_best + s.c * y_best * y_best;
    float on_horizontal = s.a * x_best * x_best + s.b * x_best * dy + s.c * dy * dy;
    // a hair wider than exact, for rounding: each pixel decides again whether it is drawn
    return fminf(on_vertical, on_horizontal) <= (s.log_alpha - LOG2_ALPHA_MIN) * 1.0001f + 1e-4f;
}
