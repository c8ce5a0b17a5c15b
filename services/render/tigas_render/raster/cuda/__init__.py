"""The CUDA tile rasteriser. `rasterizer` drives it; `kernels` has the CUDA C++, which is compiled on first use."""
