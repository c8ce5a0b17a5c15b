"""The depth that a CUDA job draws, before it is quantised and encoded."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tigas_render.raster.base import Depth, depth_size, inverse_depth

if TYPE_CHECKING:
    from tigas_render.raster.cuda.rasterizer import CudaJob


def exact_depth(job: CudaJob) -> Depth:
    """Run a job with depth, and read the depth from the device."""
    job.run()
    columns, rows = depth_size(job.camera.intrinsics.width, job.camera.intrinsics.height)
    means = job.workspace._buffers["depth"][: 8 * columns * rows].cpu().numpy().view(np.float32)
    return inverse_depth(means.reshape(rows, columns, 2))
