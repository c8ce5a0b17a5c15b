// A frame's parameters and buffers, and the arithmetic that all kernels share.
// No headers are included, because NVRTC compiles this on machines without a CUDA toolkit.
#pragma once

typedef unsigned char u8;
typedef unsigned short u16;
typedef unsigned int u32;
typedef unsigned long long u64;

constexpr int CHUNK = 256;  // number of neighbouring Gaussians that are culled together, and threads per block
constexpr u32 ALL = 0xffffffffu;

// Constants of rendering; base.py defines the first four.
constexpr float NEAR_PLANE = 0.01f;
constexpr float LOG2_ALPHA_MIN = -7.9943534f;  // log2(1 / 255)
constexpr float ALPHA_MAX = 0.999f;
constexpr float TRANSMITTANCE_MIN = 1e-4f;
constexpr float FARTHEST = 1e7f;  // float32 cannot resolve fractions of a pixel beyond this distance in pixels
constexpr float LOG2_E = 1.44269504f;

// Depth bins, evenly spaced in a float's bits: 256 per octave, from 2^-8 to 2^24. Slices consist of whole bins.
constexpr int DEPTH_BINS = 8192;

__device__ __forceinline__ u32 depth_bin(float depth) {
    int bin = (__float_as_int(depth) >> 15) - (119 << 8);
    return min(max(bin, 0), DEPTH_BINS - 1);
}

// A tile's entries are blended in segments, in parallel. A scene with few Gaussians needs short segments to keep the
// whole device busy; long segments cost less in total.
constexpr u32 MIN_SEGMENT = 512, MAX_SEGMENT = 2048, MAX_SEGMENTS = 64;

// Each block of `begin` has a range of consecutive chunks. compiler.py launches at most this number of blocks.
constexpr u32 MAX_RANGES = 1024;

// Counters that the kernels of a frame share. Each frame leaves the first five at zero; `begin` sets the others.
struct Progress {
    u32 depths[DEPTH_BINS];  // chosen chunks by the depth of their centres
    u32 culled;    // blocks that have finished culling
    u32 large;     // visible Gaussians with many tiles
    u32 taken;     // segments that have been started
    u32 queued[MAX_SEGMENTS];  // tiles that have a first, second, ... segment
    u32 chosen;    // chunks that may be visible, even if the buffers do not have room for all
    u64 entries;   // entries of all lists together
    u32 partials;  // partial images of tiles that are blended in several segments
    u32 segment;   // entries per segment
    u32 range;     // chunks per block of `begin`
    u32 ranges;    // blocks of `begin`
    u32 before[MAX_RANGES];  // chosen chunks before each range
};

// Entries per segment of a tile: more if it would have too many segments.
__device__ __forceinline__ u32 segment_length(const Progress& progress, u32 entries) {
    return max(progress.segment, (entries - 1) / MAX_SEGMENTS + 1);
}

// DEPTH: the means of weight / z and of weight instead of colours, float [H, W, 2].
enum Format { RGB = 0, JPEG_PLANES = 1, VIDEO_PLANES = 2, DEPTH = 3 };

// A frame, which parameters.py writes and `begin` copies to the device. Pointers first.
struct Frame {
    // the packed scene, see scene.py; padded to whole chunks
    const float* means;     // [3, padded]
    const uint4* shapes;    // [padded] log2 scales, opacity and quaternion, 16 bits each
    const uint2* sh;        // [groups, padded] four half-precision coefficients per group
    const float4* bounds;   // [chunks, 2] centre and radius of a chunk; largest deviation, a cell's edge, its parent
    // intermediate results of this frame; `slots` are the Gaussians of the chosen chunks, in the scene's order
    float4* splats;         // [slots, 2] records of visible Gaussians
    float* depths;          // [slots]
    ushort4* boxes;         // [slots] tiles that a Gaussian may touch: first x, first y, columns, rows
    u32* chosen;            // [chunks] chunks that may be visible, for each range from the range's first chunk on
    u32* large;             // [slots] slots of visible Gaussians with many tiles
    u8* slice_of;           // [DEPTH_BINS] the slice of each depth bin
    u32* counts;            // [tiles, slices] entries of each list
    u32* starts;            // [tiles, slices] start of each list
    u32* ends;              // [tiles, slices] end of each list; while lists are being filled, the next free place
    u64* entries;           // [capacity] depth << 32 | slot; the lists of a tile follow one another
    u32* queue;             // [MAX_SEGMENTS, tiles] tiles with a first, second, ... segment
    u32* partial_of;        // [tiles] index of a tile's first partial image
    u32* finished;          // [tiles] number of blended segments
    float* lights;          // [tiles, MAX_SEGMENTS] maximum transmittance of a segment at any pixel; 1 until finished
    float4* partials;       // [capacity / 256, side²] red, green, blue, light
    u8* pixels;             // RGB [H, W, 3], three planes, or depth
    u32* status;            // pinned, `Status` of workspace.py: number of entries, at most 2^32 - 1, and chosen chunks
    Progress* progress;
    u32 padded, capacity, room;  // room: number of chosen chunks for which there are slots
    u32 tiles, tiles_x, slices;  // slices: a power of two, at most 256
    int width, height, format, sh_coefficients;
    float scale_low, scale_step;  // log2 scale = scale_low + scale_step * code
    float rotation[9];      // world to camera, row by row
    float eye[3];
    float fx, fy, cx, cy;
    float dilation, filtered;  // added to a projected covariance, in pixels²: without the low-pass filter, and with it
    float left, right, top, bottom;  // limits of x / z and y / z where the projection's derivative is taken [gsplat]
    float background[3];
    float reach;            // maximum length of a cell's edge per unit of depth; 0 for the full detail
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
// The quadratic is convex, so its minimum over the rectangle is at the centre, or on one of the at most two edges that
// face the centre. This exact, opacity-aware intersection is that of [StopThePop] (Radl et al. 2024) and [Speedy-Splat]
// (Hanson et al. 2025).
__device__ __forceinline__ bool touches(const Splat& s, float x0, float x1, float y0, float y1) {
    x0 -= s.u, x1 -= s.u, y0 -= s.v, y1 -= s.v;
    float dx = clamp(0.f, x0, x1), dy = clamp(0.f, y0, y1);
    float y_best = clamp(__fdividef(-0.5f * s.b * dx, s.c), y0, y1);  // on the facing vertical edge
    float x_best = clamp(__fdividef(-0.5f * s.b * dy, s.a), x0, x1);  // on the facing horizontal edge
    float on_vertical = s.a * dx * dx + s.b * dx * y_best + s.c * y_best * y_best;
    float on_horizontal = s.a * x_best * x_best + s.b * x_best * dy + s.c * dy * dy;
    // slightly wider than exact, for rounding; each pixel is tested again when it is drawn
    return fminf(on_vertical, on_horizontal) <= (s.log_alpha - LOG2_ALPHA_MIN) * 1.0001f + 1e-4f;
}
