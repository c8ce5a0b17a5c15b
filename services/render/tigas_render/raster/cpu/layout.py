"""How the rasteriser's arrays are laid out: the vocabulary that its kernels share."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tigas_render.raster.base import ALPHA_MIN, Camera, derivative_limits, footprint

CHUNK = 256
"""Gaussians that are neighbours in space and are culled, projected and stored together."""
LANES = 16
"""Gaussians or pixels per pass of an inner loop: one AVX-512 register of float32, two of AVX2."""

BLOCK = 4
"""Pixels are blended in squares of this side: BLOCK² = LANES."""
TILE = 32
"""Gaussians are binned and sorted per square of this side, in pixels."""
TILE_BLOCKS = TILE // BLOCK

# A scene's geometry: float32 [chunks, GEOMETRY, CHUNK]
MEAN_X, MEAN_Y, MEAN_Z = 0, 1, 2
COV_XX, COV_XY, COV_XZ, COV_YY, COV_YZ, COV_ZZ = 3, 4, 5, 6, 7, 8
LOG_ALPHA = 9
"""log2(opacity) · ALPHA_SCALE; -2 for padding, which hides it."""
GEOMETRY = 10

# A scene's chunk bounds: float64 [chunks, BOUNDS]: least and greatest mean, then the greatest standard deviation
BOUND_LOW, BOUND_HIGH, BOUND_SCALE = 0, 3, 6
BOUNDS = 7

# A visible Gaussian ("splat"): float32 [RECORD], one cache line.
# log2(alpha) · ALPHA_SCALE at an offset (dx, dy) pixels from the centre is LOG + XX·dx² + XY·dx·dy + YY·dy².
CENTRE_X, CENTRE_Y = 0, 1
XX, XY, YY, LOG = 2, 3, 4, 5
RED, GREEN, BLUE = 6, 7, 8
COLUMNS, ROWS = 9, 10
"""Pixels that it may touch: first | (last + 1) << 16, as the bits of an uint32."""
DEPTH = 11
USED = 12
RECORD = 16

ALPHA_SCALE = 1 / 8
"""Visible alphas, 1/255 to 1, have a scaled logarithm of -1 to 0, where a short polynomial serves for exp2."""
LOG_ALPHA_MIN = math.log2(ALPHA_MIN) * ALPHA_SCALE
"""The scaled logarithm below which a Gaussian is not drawn."""

# A camera: float64 [VIEW]
ROTATION = 0
"""Nine numbers: world to camera, row by row."""
EYE = 9
"""Three numbers: the camera's centre."""
FX, FY, CX, CY = 12, 13, 14, 15
LEFT, RIGHT, TOP, BOTTOM = 16, 17, 18, 19
"""Limits of x/z and y/z at which the projection's derivative is taken."""
WIDTH, HEIGHT = 20, 21
DILATION, FILTERED = 22, 23
"""Added to the diagonal of a projected covariance, in pixels²: before the low-pass filter, and with it."""
VIEW = 24


def fill_view(camera: Camera, antialiased: bool, view: NDArray[np.float64]) -> None:
    """Write a camera into `view` [VIEW]; antialiased: how the scene was trained."""
    k = camera.intrinsics
    view[ROTATION:EYE] = np.array(camera.pose.rotation).T.ravel()
    view[EYE:FX] = camera.pose.position
    view[FX:LEFT] = k.fx, k.fy, k.cx, k.cy
    view[LEFT:WIDTH] = derivative_limits(camera.viewport)
    view[WIDTH], view[HEIGHT] = k.width, k.height
    dilation, low_pass = footprint(camera.display_scale, antialiased)
    view[DILATION], view[FILTERED] = dilation, dilation + low_pass
