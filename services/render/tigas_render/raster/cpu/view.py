"""A camera as the kernels take it: a few numbers in one array, prepared in float64."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tigas_render.raster.base import Camera, derivative_limits, footprint

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
