"""How the rasteriser's arrays are laid out: the vocabulary that its kernels share."""

from __future__ import annotations

import math

from tigas_render.raster.base import ALPHA_MIN

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
