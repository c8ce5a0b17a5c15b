// Conversion of colours to bytes: RGB, planes for JPEG and video, or the numbers of depth unchanged.
#pragma once
#include "frame.cuh"

// Values of the planes for a colour in [0, 255]: luma from one pixel, chroma from the mean of four.
// JFIF: BT.601, full range. Video: BT.709, limited range (ITU-R BT.709-6), as in encode/images.py.
struct Planes {
    bool video;
    float kr, kb;

    __device__ __forceinline__ explicit Planes(int format)
        : video(format == VIDEO_PLANES), kr(video ? 0.2126f : 0.299f), kb(video ? 0.0722f : 0.114f) {}
    __device__ __forceinline__ float luma(float r, float g, float b) const {
        return kr * r + (1 - kr - kb) * g + kb * b;
    }
    __device__ __forceinline__ u8 y(float luma) const { return (u8)(video ? 16.5f + 219.f / 255 * luma : luma + 0.5f); }
    __device__ __forceinline__ u8 cb(float b, float luma) const { return chroma((b - luma) / (1 - kb)); }
    __device__ __forceinline__ u8 cr(float r, float luma) const { return chroma((r - luma) / (1 - kr)); }
    __device__ __forceinline__ u8 chroma(float difference) const {
        return (u8)clamp(128.5f + (video ? 224.f / 255 : 1.f) * 0.5f * difference, 0.f, 255.f);
    }
};

__device__ __forceinline__ float rounded(float colour) { return floorf(clamp(colour, 0.f, 1.f) * 255 + 0.5f); }

// Fills the whole image with the background, or with zeros for depth. Called by thread number `thread` of `threads`.
__device__ __forceinline__ void fill(const Frame& f, u32 thread, u32 threads) {
    if (f.format == DEPTH) {
        for (u32 at = thread; at < (u32)(f.width * f.height); at += threads) ((float2*)f.pixels)[at] = make_float2(0, 0);
        return;
    }
    float r = rounded(f.background[0]), g = rounded(f.background[1]), b = rounded(f.background[2]);
    u32 area = f.width * f.height, chroma = ((f.width + 1) / 2) * ((f.height + 1) / 2);
    Planes planes(f.format);
    float luma = planes.luma(r, g, b);
    u8 y = planes.y(luma), cb = planes.cb(b, luma), cr = planes.cr(r, luma);
    u32 bytes = f.format == RGB ? 3 * area : area + 2 * chroma;
    for (u32 word = thread; word < (bytes + 3) / 4; word += threads) {
        u32 four = 0;
#pragma unroll
        for (u32 k = 0; k < 4; k++) {
            u32 at = 4 * word + k, channel = at % 3;
            u8 byte = f.format == RGB ? (u8)(channel == 0 ? r : channel == 1 ? g : b)
                                      : (at < area ? y : at < area + chroma ? cb : cr);
            four |= (u32)byte << 8 * k;
        }
        ((u32*)f.pixels)[word] = four;
    }
}

// Stores a pixel in the frame's format. All lanes of the warp must call it; lanes 1 and 8 apart are neighbours.
__device__ __forceinline__ void store(const Frame& f, int x, int y, bool inside, float r, float g, float b) {
    if (f.format == DEPTH) {
        if (inside) ((float2*)f.pixels)[(u64)y * f.width + x] = make_float2(r, g);
        return;
    }
    r = rounded(r), g = rounded(g), b = rounded(b);
    if (f.format == RGB) {
        if (!inside) return;
        u8* at = f.pixels + 3 * ((u64)y * f.width + x);
        at[0] = (u8)r, at[1] = (u8)g, at[2] = (u8)b;
        return;
    }
    Planes planes(f.format);
    float luma = planes.luma(r, g, b);
    u64 area = (u64)f.width * f.height;
    if (inside) f.pixels[(u64)y * f.width + x] = planes.y(luma);
    // the mean of four pixels; at an odd edge the last column or row counts twice
    bool more_x = (x | 1) < f.width, more_y = (y | 1) < f.height;
    float means[3] = {r, b, luma};
#pragma unroll
    for (int k = 0; k < 3; k++) {
        float across = __shfl_xor_sync(ALL, means[k], 1);
        means[k] += more_x ? across : means[k];
        float down = __shfl_xor_sync(ALL, means[k], 8);
        means[k] = 0.25f * (means[k] + (more_y ? down : means[k]));
    }
    if (!inside || (x & 1) || (y & 1)) return;
    u32 columns = (f.width + 1) / 2, rows = (f.height + 1) / 2;
    u8* at = f.pixels + area + (u64)(y / 2) * columns + x / 2;
    at[0] = planes.cb(means[1], means[2]);
    at[(u64)rows * columns] = planes.cr(means[0], means[2]);
}
