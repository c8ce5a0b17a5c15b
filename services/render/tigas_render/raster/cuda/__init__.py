"""The CUDA tile rasteriser: `rasterizer` drives it, `kernels` holds the CUDA C++, compiled when it is first used."""
