"""The layout of the rasteriser's arrays, shared by its kernels."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tigas_render.raster.base import ALPHA_MIN, Camera, derivative_limits, footprint

CHUNK = 256
"""Number of Gaussians, neighbours in space, that are culled, projected and stored together."""
LANES = 16
"""Gaussians or pixels per pass of an inner loop: one AVX-512 register of float32, or two of AVX2."""

BLOCK = 4
"""Side length in pixels of the squares in which pixels are blended: BLOCK² = LANES."""
TILE = 32
"""Side length in pixels of the squares for which Gaussians are binned and sorted."""
TILE_BLOCKS = TILE // BLOCK

# A scene's geometry: float32 [chunks, GEOMETRY, CHUNK]
MEAN_X, MEAN_Y, MEAN_Z = 0, 1, 2
COV_XX, COV_XY, COV_XZ, COV_YY, COV_YZ, COV_ZZ = 3, 4, 5, 6, 7, 8
LOG_ALPHA = 9
"""log2(opacity) · ALPHA_SCALE; -2 hides padding."""
GEOMETRY = 10

# A scene's chunk bounds: float64 [chunks, BOUNDS], minimum and maximum of the means, then the largest deviation
BOUND_LOW, BOUND_HIGH, BOUND_SCALE = 0, 3, 6
BOUNDS = 7

# A visible Gaussian ("splat"): float32 [RECORD], one cache line.
# log2(alpha) · ALPHA_SCALE at an offset (dx, dy) pixels from the centre is LOG + XX·dx² + XY·dx·dy + YY·dy².
CENTRE_X, CENTRE_Y = 0, 1
XX, XY, YY, LOG = 2, 3, 4, 5
RED, GREEN, BLUE = 6, 7, 8
COLUMNS, ROWS = 9, 10
"""Pixels that the splat may touch: first | (last + 1) << 16, as the bits of a uint32."""
DEPTH = 11
USED = 12
RECORD = 16

ALPHA_SCALE = 1 / 8
"""Scales the logarithms of visible alphas, 1/255 to 1, to -1 to 0, where a short polynomial approximates exp2."""
LOG_ALPHA_MIN = math.log2(ALPHA_MIN) * ALPHA_SCALE
"""The scaled logarithm below which a Gaussian is not drawn."""

# A camera: float64 [VIEW]
ROTATION = 0
"""Nine numbers: rotation from world to camera, row by row."""
EYE = 9
"""Three numbers: the camera's position."""
FX, FY, CX, CY = 12, 13, 14, 15
LEFT, RIGHT, TOP, BOTTOM = 16, 17, 18, 19
"""Limits of x/z and y/z at which the projection's derivative is taken."""
WIDTH, HEIGHT = 20, 21
DILATION, FILTERED = 22, 23
"""Values added to the diagonal of a projected covariance in pixels²: without the low-pass filter, and with it."""
VIEW = 24


def fill_view(camera: Camera, antialiased: bool, view: NDArray[np.float64]) -> None:
    """Write a camera into `view` [VIEW]. antialiased: whether the scene was trained so."""
    k = camera.intrinsics
    view[ROTATION:EYE] = np.array(camera.pose.rotation).T.ravel()
    view[EYE:FX] = camera.pose.position
    view[FX:LEFT] = k.fx, k.fy, k.cx, k.cy
    view[LEFT:WIDTH] = derivative_limits(camera.viewport)
    view[WIDTH], view[HEIGHT] = k.width, k.height
    dilation, low_pass = footprint(camera.display_scale, antialiased)
    view[DILATION], view[FILTERED] = dilation, dilation + low_pass
