"""The CUDA tile rasteriser: `rasterizer` drives it, `kernels` holds the CUDA C++, which is compiled at first use."""

from tigas_render.raster.cuda.rasterizer import CudaRasterizer

__all__ = ["CudaRasterizer"]
