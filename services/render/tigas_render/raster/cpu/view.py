"""A camera as the kernels take it: a few numbers in one array, prepared in float64."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tigas_render.raster.base import Camera, derivative_limits

ROTATION = 0
"""Nine numbers: world to camera, row by row."""
EYE = 9
"""Three numbers: the camera's centre."""
FX, FY, CX, CY = 12, 13, 14, 15
LEFT, RIGHT, TOP, BOTTOM = 16, 17, 18, 19
"""Limits of x/z and y/z at which the projection's derivative is taken."""
WIDTH, HEIGHT = 20, 21
VIEW = 22


def fill_view(camera: Camera, view: NDArray[np.float64]) -> None:
    """Write a camera into `view` [VIEW]."""
    k = camera.intrinsics
    view[ROTATION:EYE] = np.array(camera.pose.rotation).T.ravel()
    view[EYE:FX] = camera.pose.position
    view[FX:LEFT] = k.fx, k.fy, k.cx, k.cy
    view[LEFT:WIDTH] = derivative_limits(k)
    view[WIDTH], view[HEIGHT] = k.width, k.height
