"""The CPU tile rasteriser, compiled by Numba. `rasterizer` drives the stages, which have one module each."""

from tigas_render.raster.cpu.rasterizer import CpuRasterizer

__all__ = ["CpuRasterizer"]
