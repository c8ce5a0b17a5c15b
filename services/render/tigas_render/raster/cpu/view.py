"""A camera as the kernels take it: a few numbers in one array, prepared in float64."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tigas_render.raster.base import Camera

ROTATION = 0
"""Nine numbers: world to camera, row by row."""
EYE = 9
"""Three numbers: the camera's centre."""
FX, FY, CX, CY = 12, 13, 14, 15
LEFT, RIGHT, TOP, BOTTOM = 16, 17, 18, 19
"""Limits of x/z and y/z at which the projection's derivative is taken; gsplat 1.5.3's."""
WIDTH, HEIGHT = 20, 21
VIEW = 22

CLAMP_MARGIN = 0.3
"""How far the limits lie outside the picture, in half-widths of the picture."""


def fill_view(camera: Camera, view: NDArray[np.float64]) -> None:
    """Write a camera into `view` [VIEW]."""
    k = camera.intrinsics
    view[ROTATION:EYE] = np.array(camera.pose.rotation).T.ravel()
    view[EYE:FX] = camera.pose.position
    view[FX:LEFT] = k.fx, k.fy, k.cx, k.cy
    margin_x, margin_y = CLAMP_MARGIN * 0.5 * k.width / k.fx, CLAMP_MARGIN * 0.5 * k.height / k.fy
    view[LEFT], view[RIGHT] = -k.cx / k.fx - margin_x, (k.width - k.cx) / k.fx + margin_x
    view[TOP], view[BOTTOM] = -k.cy / k.fy - margin_y, (k.height - k.cy) / k.fy + margin_y
    view[WIDTH], view[HEIGHT] = k.width, k.height
